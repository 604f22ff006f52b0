"""Settings from plain values and back: what Hydra composes, a preset holds, or Python gives as mappings."""

import os
import re
import types
from collections.abc import Container, Mapping
from dataclasses import MISSING, fields, is_dataclass, replace
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from aerial_il.core import presets, registry
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.schema import (
    FROM,
    Choice,
    Name,
    bare,
    default_of,
    group_of,
    hints_of,
    keys,
    marked,
    options,
    unknown_key,
)

_PLAIN: dict[type, tuple[type, ...]] = {bool: (bool,), int: (int,), float: (int, float), str: (str,)}
_IN_WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}


def build[S](kind: type[S], given: Mapping[str, Any], *, base: S | None = None, at: str = "") -> S:
    """Return settings of ``kind``: those of ``base``, or the defaults, with what is ``given`` changed, nested likewise.

    Args:
        kind: a dataclass; its ``PRESETS`` names keys beside its own, each of which sets several of them; where it has
            ``like(place, typed)``, the key ``from`` names earlier work, whose settings are the base if none is handed.
        given: key -> value; mappings for groups, lists for tuples, names or mappings with a name for choices.
        at: where they stand, e.g. ``algorithm.``, for errors.

    Raises:
        UnknownNameError: there is no such setting or choice.
        InvalidValueError: a value does not fit, or one is missing.
    """
    if given.get(FROM) is not None and hasattr(kind, "like"):
        like = base_of(kind, given[FROM], {*given}) if base is None else base
        _require(kind, {*given}, at)
        return build(kind, {name: value for name, value in given.items() if name != FROM}, base=like, at=at)
    sets = getattr(kind, "PRESETS", ())
    if said := next((name for name in sets if given.get(name) is not None), None):
        return _over_preset(kind, {**given}, said, base, at)
    hints, known = hints_of(kind), {f.name: f for f in fields(kind) if f.init}  # type: ignore[arg-type]
    values: dict[str, Any] = {}
    for name, value in given.items():
        if name in sets or (name == FROM and hasattr(kind, "like")):  # null
            continue
        if name not in known:
            raise unknown_key(f"{at}{name}", [key.name for key in keys(kind, base=base, at=at)])
        before = getattr(base, name) if base is not None else default_of(known[name])
        values[name] = _value(hints[name], value, None if before is MISSING else before, f"{at}{name}")
    if base is None:
        _require(kind, {*values}, at)
    try:
        return replace(base, **values) if base is not None else kind(**values)  # type: ignore[type-var]
    except InvalidValueError as error:
        named = re.split(r"\W", str(error), maxsplit=1)[0] in known
        raise type(error)(f"{at if named else ''}{error}") from error


def base_of(kind: type, place: Any, typed: Container[str]) -> Any:
    """Return the settings of the earlier work in ``place``, which ``from`` names; None where nothing does.

    Args:
        typed: keys that are set beside it.

    Raises:
        InvalidValueError: there is no such work, or its settings are of another version.
    """
    return kind.like(os.fspath(place), typed) if place is not None and hasattr(kind, "like") else None


def _require(kind: type, given: Container[str], at: str) -> None:
    """Refuse to go on without what has no default."""
    needed = (f.name for f in fields(kind) if f.init and default_of(f) is MISSING)
    if lacking := sorted(name for name in needed if name not in given):
        wanted = " ".join(f"{at}{name}=..." for name in lacking)
        raise InvalidValueError(f"{(at[:-1] or kind.__name__).lower()} needs {wanted}")


def changed[S](settings: S, changes: Mapping[str, Any]) -> S:
    """Return settings with some of their values changed, nested ones likewise; see :func:`build`."""
    return build(type(settings), changes, base=settings)


def _over_preset[S](kind: type[S], given: dict[str, Any], preset: str, base: S | None, at: str) -> S:
    """Return settings in which what is ``given`` stands over what the preset says that is named in it."""
    name = given.pop(preset)
    below = presets.read(preset, name)
    try:
        return build(kind, _over(below, given), base=base, at=at)
    except UnknownNameError as error:
        group, _, inner = str(error.value).partition(".")
        if error.kind != "key" or inner.partition(".")[0] not in (below.get(group) or ()):
            raise
        choice = given.get(group)
        choice = choice.get("name") if isinstance(choice, Mapping) else choice
        raise InvalidValueError(
            f"{preset}={name} sets {error.value}, which {group}={choice} does not have: leave out {preset}={name}, and "
            "set what you want of it."
        ) from error


def chosen(kind: str, value: Any, before: Any = None, at: str = "") -> Any:
    """Return the settings that ``value`` stands for: settings themselves, a name, or a mapping with a name.

    Args:
        before: what a mapping without a name changes: settings, or the name of some. at: as of :func:`build`.
    """
    value = {"name": value} if isinstance(value, str) else value
    if is_dataclass(value) and not isinstance(value, type):
        return value
    if not isinstance(value, Mapping):
        raise UnknownNameError(kind, value, options(kind))
    changes, name = {key: each for key, each in value.items() if key != "name"}, value.get("name", before)
    if is_dataclass(name) and not isinstance(name, type):
        return build(type(name), changes, base=name, at=at)
    if not isinstance(name, str) or name not in options(kind):
        raise UnknownNameError(kind, name, options(kind), registry.KINDS[kind].hint)
    said = presets.read(kind, name) if name in presets.names(kind) else {}
    settings = registry.get(kind, said.pop("name", name))
    base = build(settings, said, at=at)
    return build(settings, changes, base=base, at=at) if changes else base


def plain(settings: Any) -> dict[str, Any]:
    """Return settings as nested plain values, of which :func:`build` makes the same again."""
    hints, values = hints_of(type(settings)), dict[str, Any]()
    for field in fields(settings):
        value, choice = getattr(settings, field.name), marked(hints[field.name], Choice)
        if is_dataclass(value):
            name = {"name": registry.name_of(choice.kind, type(value))} if choice is not None else {}
            values[field.name] = name | plain(value)
        elif field.init:
            values[field.name] = _listed(value)
    return values


def dotted(tree: Any, prefix: str = "") -> dict[str, Any]:
    """Return dotted keys -> the leaves of nested mappings; an empty mapping is a leaf."""
    if not isinstance(tree, Mapping) or not tree:
        return {prefix.rstrip("."): tree}
    return {key: leaf for name, value in tree.items() for key, leaf in dotted(value, f"{prefix}{name}.").items()}


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
    if origin is Annotated:
        return in_words(inner[0])
    if origin in (Union, types.UnionType):
        return " or ".join(map(in_words, inner))
    if origin is Literal:
        return "one of " + ", ".join(map(str, inner))
    if origin in (tuple, list):
        return "a list such as [a,b]"
    return "null" if hint is types.NoneType else _IN_WORDS.get(hint, getattr(hint, "__name__", str(hint)))


def _value(hint: Any, value: Any, before: Any, at: str) -> Any:
    """Return a value as its hint wants it, checked."""
    nothing = value is None and types.NoneType in get_args(bare(hint))
    if (choice := marked(hint, Choice)) is not None and not nothing:
        return chosen(choice.kind, value, before, f"{at}.")
    inner = group_of(hint, before)
    if isinstance(value, os.PathLike):  # never a preset's name
        value = {"path": os.fspath(value)} if inner is not None else os.fspath(value)
    if inner is not None and value is not None and not is_dataclass(value):
        return _nested(inner, value, before, at)
    if isinstance(before, Mapping) and isinstance(value, Mapping):
        return _merged(hint, value, before, at)
    if isinstance(value, list) or not fits(value, hint):
        given, value = value, _coerced(value, bare(hint))
        if not fits(value, hint):
            raise InvalidValueError(f"{at}={repr(given)[:80]} is not {in_words(hint)}.")
    if isinstance(value, str) and (named := marked(hint, Name)) is not None:
        named.check(value)
    return value


def _nested(inner: type, value: Any, before: Any, at: str) -> Any:
    """Return a group of settings from a mapping, a preset's name or, where the group has one, its path."""
    known = inner.__dataclass_fields__
    if isinstance(value, str) and value in presets.names(at):
        value = {"name": value}
    if isinstance(value, str) and "path" in known:
        value = {"path": value}
    if not isinstance(value, Mapping):
        inside = ", ".join(f"{at}.{name}" for name in known)
        raise InvalidValueError(f"{at}={repr(value)[:80]}: it is a group; set one of its keys, {inside}.")
    if "name" in value and "name" not in known and presets.names(at):
        said = {name: each for name, each in value.items() if name != "name"}
        value = _over(presets.read(at, value["name"]), said)
    return build(inner, value, base=before, at=f"{at}.")


def _merged(hint: Any, value: Mapping[str, Any], before: Mapping[str, Any], at: str) -> dict[str, Any]:
    """Return a mapping with what is given changed or added; null takes an entry out unless it is a value."""
    inside = (get_args(bare(hint)) or (Any, Any))[-1]
    gone = {name for name, each in value.items() if each is None and not fits(None, inside)}
    given = {n: _value(inside, v, before.get(n), f"{at}.{n}") for n, v in value.items() if n not in gone}
    return {name: each for name, each in {**before, **given}.items() if name not in gone}


def _coerced(value: Any, hint: Any) -> Any:
    """Return lists as tuples, and a single value as a tuple of it where the hint wants several."""
    if isinstance(value, list):
        return tuple(_coerced(each, None) for each in value)
    several = get_origin(hint) is tuple or any(get_origin(each) is tuple for each in get_args(hint))
    single = isinstance(value, str | int | float) and not isinstance(value, bool)
    return (value,) if several and single and fits((value,), hint) else value


def _over(base: Mapping[str, Any], said: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``base`` with what is said over it; a name over a mapping chooses, and the mapping changes the choice."""
    merged = dict(base)
    for key, value in said.items():
        if isinstance(merged.get(key), Mapping) and isinstance(value, Mapping | str):
            merged[key] = _over(merged[key], {"name": value} if isinstance(value, str) else value)
        else:
            merged[key] = value
    return merged


def _listed(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return plain(value)
    if isinstance(value, Mapping):
        return {name: _listed(each) for name, each in value.items()}
    return [_listed(each) for each in value] if isinstance(value, tuple | list) else value


def _items_fit(value: list[Any] | tuple[Any, ...], origin: Any, inner: tuple[Any, ...]) -> bool:
    if not inner:
        return True
    if origin is list or inner[-1] is Ellipsis:
        return all(fits(each, inner[0]) for each in value)
    return len(value) == len(inner) and all(map(fits, value, inner))
