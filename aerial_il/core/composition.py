"""Settings from plain values and back: what Hydra composes, a run's config.yaml holds, or Python gives as mappings.

The dataclasses are the schema: names, types, defaults and meanings (``Attributes`` of docstrings) are read from them.
"""

from __future__ import annotations

import inspect
import re
import types
import typing
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, Field, asdict, dataclass, fields, is_dataclass, replace
from typing import Any, Union, get_args, get_origin

from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.fitting import fits, in_words
from aerial_il.core.renamed import moved

_MEANING = re.compile(r"^    ((?:\w+, )*\w+): (.+(?:\n {8,}.+)*)", re.MULTILINE)


@dataclass(frozen=True)
class Key:
    """One setting: its dotted name, default, and what it means."""

    name: str
    default: Any
    meaning: str


def build[S](kind: type[S], given: Mapping[str, Any], *, base: S | None = None, at: str = "") -> S:
    """Return settings of ``kind``: those of ``base``, or the defaults, with what is ``given`` changed, nested likewise.

    Args:
        at: where they stand, e.g. ``algorithm.``, for errors.

    Raises:
        UnknownNameError: there is no such setting. InvalidValueError: a value does not fit, or one is missing.
    """
    hints, known = typing.get_type_hints(kind), {f.name: f for f in fields(kind)}  # type: ignore[arg-type]
    values: dict[str, Any] = {}
    for name, value in given.items():
        if name not in known:
            if new := moved(name, {key.name for key in keys(kind)}):
                raise InvalidValueError(f"{at}{name} is called {at}{new} now.")
            raise UnknownNameError("key", f"{at}{name}", [f"{at}{each}" for each in known])
        before = getattr(base, name) if base is not None else _default(known[name])
        values[name] = _value(hints[name], value, None if before is MISSING else before, f"{at}{name}")
    lacking = [f"{at}{n}" for n, f in known.items() if base is None and n not in values and _default(f) is MISSING]
    if lacking:
        raise InvalidValueError(f"{', '.join(lacking)} must be given.")
    try:
        return replace(base, **values) if base is not None else kind(**values)  # type: ignore[type-var]
    except InvalidValueError as error:
        raise type(error)(f"{at}{error}") from error


def plain(settings: Any) -> dict[str, Any]:
    """Return settings as nested plain values, of which :func:`build` makes the same again."""
    return asdict(settings)


def keys(kind: type, *, base: Any = None, at: str = "") -> Iterator[Key]:
    """Yield every setting of ``kind``, nested ones in their place, with the defaults of ``base`` or its own."""
    said, hints = meanings(kind), typing.get_type_hints(kind)
    for field in fields(kind):
        default = getattr(base, field.name) if base is not None else _default(field)
        inner = _group(hints[field.name])
        if inner is None or default is None:
            yield Key(f"{at}{field.name}", default, said.get(field.name, ""))
        if inner is not None:
            yield from keys(inner, base=None if default in (None, MISSING) else default, at=f"{at}{field.name}.")


def meanings(kind: type) -> dict[str, str]:
    """Return what the docstrings of ``kind`` and of its bases say of each setting."""
    found: dict[str, str] = {}
    for each in reversed(kind.__mro__):
        _, _, said = inspect.cleandoc(each.__doc__ or "").partition("Attributes:\n")
        for names, text in _MEANING.findall(said):
            found |= dict.fromkeys(names.split(", "), " ".join(text.split()))
    return found


def _default(field: Field[Any]) -> Any:
    return field.default if field.default_factory is MISSING else field.default_factory()


def _value(hint: Any, value: Any, before: Any, at: str) -> Any:
    inner = type(before) if is_dataclass(before) and not isinstance(before, type) else _group(hint)
    if isinstance(before, Mapping) and isinstance(value, Mapping):
        return _merged(hint, value, before, at)
    if inner is not None and isinstance(value, Mapping):
        return build(inner, value, base=before, at=f"{at}.")
    if inner is not None and isinstance(value, str) and "path" in inner.__dataclass_fields__:  # prior=PATH: prior.path
        return build(inner, {"path": value}, base=before, at=f"{at}.")
    if inner is not None and value is not None and not is_dataclass(value):
        inside = ", ".join(f"{at}.{field.name}" for field in fields(inner))
        raise InvalidValueError(f"{at}={value!r}: it is a group; set one of its keys, {inside}.")
    value = tuple(value) if isinstance(value, list) else value
    if not fits(value, hint):
        raise InvalidValueError(f"{at}={value!r} is not {in_words(hint)}.")
    return value


def _merged(hint: Any, value: Mapping[str, Any], before: Mapping[str, Any], at: str) -> dict[str, Any]:
    """Return a mapping with what is given changed or added; null takes an entry out unless it is a value."""
    _, inside = get_args(hint) or (Any, Any)
    gone = {name for name, each in value.items() if each is None and not fits(None, inside)}
    given = {n: _value(inside, v, before.get(n), f"{at}.{n}") for n, v in value.items() if n not in gone}
    return {name: each for name, each in {**before, **given}.items() if name not in gone}


def _group(hint: Any) -> type | None:
    """Return the dataclass that a hint stands for, ``Prior`` of ``Prior | None``; None for a single value."""
    options = get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)
    return next((each for each in options if is_dataclass(each) and isinstance(each, type)), None)
