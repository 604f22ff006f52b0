"""Checks that a value given on the command line has the type that its setting is declared with."""

from __future__ import annotations

import types
import typing
from collections.abc import Mapping
from dataclasses import is_dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from aerial_il.core.errors import InvalidValueError

_PLAIN: dict[type, tuple[type, ...]] = {bool: (bool,), int: (int,), float: (int, float), str: (str,)}
_IN_WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}


def check_types(constructor: Any, values: Mapping[str, Any], *, whose: str | None = None) -> None:
    """Refuse a value whose type is not the one that the class ``constructor`` declares for its field.

    Args:
        constructor: a dataclass. values: field -> value. whose: its name in the error, the class's own if left out.

    Raises:
        InvalidValueError: names the setting, the value and what it should be.
    """
    for name, hint in _hints(constructor).items():
        if name in values and not fits(values[name], hint):
            shown = repr(values[name])[:80]
            raise InvalidValueError(
                f"{name}={shown} is not {in_words(hint)}, as {whose or constructor.__name__} asks for."
            )


def fits(value: Any, hint: Any) -> bool:
    """Whether ``value``, of plain types and objects built already, may stand where ``hint`` is declared."""
    if hint in _PLAIN:
        return isinstance(value, _PLAIN[hint]) and (hint is bool or not isinstance(value, bool))
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return fits(value, inner[0])
    if origin in (Union, types.UnionType):
        return any(fits(value, each) for each in inner)
    if origin is Literal:
        return value in inner
    if hint in (None, types.NoneType):
        return value is None
    if origin in (tuple, list) or hint in (tuple, list):
        return isinstance(value, (list, tuple)) and _items_fit(value, origin, inner)
    if origin is not None and issubclass(origin, Mapping):
        return isinstance(value, Mapping) and all(fits(each, inner[1]) for each in value.values())
    return not is_dataclass(hint) or not isinstance(value, (bool, int, float, str, list, tuple, types.NoneType))


def in_words(hint: Any) -> str:
    """Return what a type is called in an error, e.g. ``a whole number or null``."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return " or ".join(map(in_words, inner))
    if origin is Literal:
        return "one of " + ", ".join(map(str, inner))
    if origin in (tuple, list):
        return "a list such as [a,b]"
    return "null" if hint is types.NoneType else _IN_WORDS.get(hint, getattr(hint, "__name__", str(hint)))


def _items_fit(value: list[Any] | tuple[Any, ...], origin: Any, inner: tuple[Any, ...]) -> bool:
    if not inner:
        return True
    if origin is list or inner[-1] is Ellipsis:
        return all(fits(each, inner[0]) for each in value)
    return len(value) == len(inner) and all(map(fits, value, inner))


def _hints(constructor: Any) -> dict[str, Any]:
    """Return the declared types of a dataclass; none where they name what only a type checker imports."""
    if not is_dataclass(constructor):
        return {}
    try:
        return typing.get_type_hints(constructor)
    except NameError:
        return {}
