"""Settings from plain values and back: what Hydra composes, a preset holds, or Python gives as mappings.

The dataclasses are the schema: names, types, defaults and meanings (``Attributes`` of docstrings) are read from them.
Where a hint carries a :class:`Choice`, settings are chosen by name among what is registered; a preset of that kind,
``conf/KIND/NAME.yaml``, is a name too. Where it carries a :class:`Name`, the value must be a registered name.
"""

from __future__ import annotations

import importlib
import inspect
import os
import re
import types
import typing
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass, replace
from typing import Annotated, Any, Union, get_args, get_origin

from aerial_il.core import presets, registry
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.fitting import fits, in_words
from aerial_il.core.renamed import moved

_MEANING = re.compile(r"^    ((?:\w+, )*\w+): (.+(?:\n {8,}.+)*)", re.MULTILINE)
_LISTED = {"tier": "aerial_il.suite.tiers"}  # names that stand in no files


@dataclass(frozen=True)
class Choice:
    """Of a hint: settings that are chosen by name, e.g. ``Annotated[Any, Choice("policy")]``."""

    kind: str


@dataclass(frozen=True)
class Name:
    """Of a hint: a name of that kind, e.g. ``Annotated[str, Name("robot")]``."""

    kind: str

    def check(self, name: str) -> None:
        if self.kind in _LISTED:
            importlib.import_module(_LISTED[self.kind]).get(name)  # a tier may be put together: gusts+latency
        elif name not in (known := options(self.kind)):
            raise UnknownNameError(self.kind, name, known, "See: aerial-il list")


def options(kind: str) -> tuple[str, ...]:
    """Return what may be chosen of a kind: what is registered, and presets."""
    if kind in _LISTED:
        return tuple(sorted(importlib.import_module(_LISTED[kind]).names()))
    return tuple(sorted({*(registry.names(kind) if kind in registry.KINDS else ()), *presets.names(kind)}))


def build[S](kind: type[S], given: Mapping[str, Any], *, base: S | None = None, at: str = "") -> S:
    """Return settings of ``kind``: those of ``base``, or the defaults, with what is ``given`` changed, nested likewise.

    Args:
        kind: a dataclass; its ``PRESETS`` names keys beside its own, each of which sets several of them.
        given: key -> value; mappings for groups, lists for tuples, names or mappings with a name for choices.
        at: where they stand, e.g. ``algorithm.``, for errors.

    Raises:
        UnknownNameError: there is no such setting or choice.
        InvalidValueError: a value does not fit, or one is missing.
    """
    sets = getattr(kind, "PRESETS", {})
    said = {name: value for name, value in given.items() if name not in sets}
    for preset, name in ((each, given[each]) for each in sets if given.get(each) is not None):
        below = presets.read(preset, name)
        try:
            return build(kind, _over(below, {k: v for k, v in given.items() if k != preset}), base=base, at=at)
        except UnknownNameError as error:
            if (
                error.kind != "key"
                or (where := str(error.value).partition("."))[0] not in below
                or where[2] not in below[where[0]]
            ):
                raise
            raise InvalidValueError(
                f"{preset}={name} sets {error.value}, which {where[0]}={_name_in(said[where[0]])} does not have: leave "
                f"out {preset}={name}, and set what you want of it."
            ) from error
    hints, known = hints_of(kind), {f.name: f for f in fields(kind) if f.init}  # type: ignore[arg-type]
    values: dict[str, Any] = {}
    for name, value in said.items():
        if name not in known:
            raise unknown_key(f"{at}{name}", [key.name for key in keys(kind, base=base, at=at)])
        before = getattr(base, name) if base is not None else _default(known[name])
        values[name] = _value(hints[name], value, None if before is MISSING else before, f"{at}{name}")
    lacking = sorted(n for n, f in known.items() if base is None and n not in values and _default(f) is MISSING)
    if lacking:
        wanted = " ".join(f"{at}{name}=..." for name in lacking)
        raise InvalidValueError(f"{(at[:-1] or kind.__name__).lower()} needs {wanted}")
    try:
        return replace(base, **values) if base is not None else kind(**values)  # type: ignore[type-var]
    except InvalidValueError as error:
        named = re.split(r"\W", str(error), maxsplit=1)[0] in known
        raise type(error)(f"{at if named else ''}{error}") from error


def chosen(kind: str, value: Any, before: Any = None, at: str = "") -> Any:
    """Return the settings that ``value`` stands for: settings themselves, a name, or a mapping with a name.

    Args:
        before: what a mapping without a name changes: settings, or the name of some. at: as of :func:`build`.
    """
    value = {"name": value} if isinstance(value, str) else value
    if not isinstance(value, Mapping):
        return value
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
    hints, found = hints_of(type(settings)), dict[str, Any]()
    for field in fields(settings):
        value, choice = getattr(settings, field.name), _marked(hints[field.name], Choice)
        if is_dataclass(value):
            name = {"name": registry.name_of(choice.kind, type(value))} if choice is not None else {}
            found[field.name] = name | plain(value)
        elif field.init:
            found[field.name] = _listed(value)
    return found


@dataclass(frozen=True)
class Key:
    """One setting, in words.

    Attributes:
        name: dotted. default: as it is typed, empty where it must be given. meaning: what its docstring says.
        takes: ``text``, ``texts``, ``mapping``, ``value``, ``place`` (a group that a path or a preset stands for),
            ``choice`` or ``preset``.
        nullable: whether ``null`` is nothing. options: the valid values, if they are few.
        kind: of what is chosen or named.
    """

    name: str
    default: str
    meaning: str
    takes: str = "value"
    nullable: bool = False
    options: tuple[str, ...] = ()
    kind: str = ""


def keys(kind: type, *, base: Any = None, at: str = "") -> Iterator[Key]:
    """Yield every setting of ``kind``, nested ones in their place, with the defaults of ``base`` or its own.

    Of a choice its name alone: what it has depends on what is chosen.
    """
    said, hints = meanings(kind), hints_of(kind)
    for field in (field for field in fields(kind) if field.init):
        default, hint = getattr(base, field.name) if base is not None else _default(field), hints[field.name]
        key, inner = _key(f"{at}{field.name}", hint, default, said.get(field.name, "")), _group(hint, default)
        if key.takes in ("place", "choice") or inner is None or default is None:
            yield key
        if inner is not None and key.takes != "choice":
            yield from keys(inner, base=None if default in (None, MISSING) else default, at=f"{at}{field.name}.")
    for name, meaning in getattr(kind, "PRESETS", {}).items():
        yield Key(name, "null", f"{meaning}: {', '.join(presets.names(name))}", "preset", nullable=True, kind=name)


def meanings(kind: type) -> dict[str, str]:
    """Return what the docstrings of ``kind`` and of its bases say of each setting."""
    found: dict[str, str] = {}
    for each in reversed(kind.__mro__):
        _, _, said = inspect.cleandoc(each.__doc__ or "").partition("Attributes:\n")
        for names, text in _MEANING.findall(said):
            found |= dict.fromkeys(names.split(", "), " ".join(text.split()))
    return found


def unknown_key(name: str, known: Iterable[str], hint: str = "") -> InvalidValueError | UnknownNameError:
    """Return the error for a key that there is not among all that are ``known``; an old one leads to its new name."""
    head, _, last = name.rpartition(".")
    beside = f"{head}." if head else ""
    every = list(known)
    inside = [each.removeprefix(beside) for each in every if each.startswith(beside)]
    if head and (new := moved(last, inside)) is not None:
        return InvalidValueError(f"{name} is called {head}.{new} now. {hint}".rstrip())
    near = [beside + each.partition(".")[0] for each in inside] or [each.partition(".")[0] for each in every]
    return UnknownNameError("key", name, dict.fromkeys(near), hint)


def hints_of(kind: type) -> dict[str, Any]:
    """Return the declared types of a dataclass, with what they are annotated with."""
    return typing.get_type_hints(kind, include_extras=True)


def _key(name: str, hint: Any, default: Any, meaning: str) -> Key:
    choice, named, bare = _marked(hint, Choice), _marked(hint, Name), _bare(hint)
    variants = get_args(bare) if get_origin(bare) in (Union, types.UnionType) else (bare,)
    literal = next((each for each in variants if get_origin(each) is typing.Literal), None)
    inner, takes = _group(hint, default), "value"
    if choice is not None:
        takes = "choice"
    elif inner is not None and ("path" in inner.__dataclass_fields__ or presets.names(name)):
        takes = "place"
    elif str in variants or (literal is not None and all(isinstance(each, str) for each in get_args(literal))):
        takes = "text"
    elif any(get_origin(each) is tuple and get_args(each)[0] is str for each in variants):
        takes = "texts"
    elif any(isinstance(get_origin(each), type) and issubclass(get_origin(each), Mapping) for each in variants):
        takes = "mapping"
    few = tuple(map(str, get_args(literal))) if literal is not None else ("true", "false") if bare is bool else ()
    kind = choice.kind if choice is not None else named.kind if named is not None else ""
    return Key(name, shown(default, kind), meaning, takes, types.NoneType in variants, few, kind)


def shown(default: Any, kind: str = "") -> str:
    """Return a default as it is typed."""
    if default is MISSING:
        return ""
    if is_dataclass(default):
        return registry.name_of(kind, type(default)) if kind else str(getattr(default, "path", None) or "null")
    if isinstance(default, Mapping):
        return "{" + ",".join(f"{name}:{shown(each)}" for name, each in default.items()) + "}"
    if isinstance(default, tuple | list):
        return "[" + ",".join(shown(each) for each in default) + "]"
    return str(default).lower() if isinstance(default, bool) else "null" if default is None else str(default)


def _default(field: Field[Any]) -> Any:
    return field.default if field.default_factory is MISSING else field.default_factory()


def _value(hint: Any, value: Any, before: Any, at: str) -> Any:
    """Return a value as its hint wants it, checked."""
    if (choice := _marked(hint, Choice)) is not None and not (
        value is None and types.NoneType in get_args(_bare(hint))
    ):
        return chosen(choice.kind, value, before, f"{at}.")
    inner = _group(hint, before)
    if isinstance(value, os.PathLike):  # never a preset's name
        value = {"path": os.fspath(value)} if inner is not None else os.fspath(value)
    if inner is not None and value is not None and not is_dataclass(value):
        return _nested(inner, value, before, at)
    if isinstance(before, Mapping) and isinstance(value, Mapping):
        return _merged(hint, value, before, at)
    if not fits(value, hint) or isinstance(value, list):
        value = _coerced(value, _bare(hint))
    if not fits(value, hint):
        raise InvalidValueError(f"{at}={repr(value)[:80]} is not {in_words(hint)}.")
    if (named := _marked(hint, Name)) is not None and value is not None:
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
    inside = (get_args(_bare(hint)) or (Any, Any))[-1]
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


def _name_in(value: Any) -> str:
    return str(value.get("name") if isinstance(value, Mapping) else value)


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
    if isinstance(value, Mapping):
        return {name: _listed(each) for name, each in value.items()}
    return [_listed(each) for each in value] if isinstance(value, tuple | list) else value


def _bare(hint: Any) -> Any:
    """Return a hint without what it is annotated with."""
    return get_args(hint)[0] if get_origin(hint) is Annotated else hint


def _marked[M](hint: Any, mark: type[M]) -> M | None:
    """Return the mark of a hint that is annotated with one, ``Annotated[...] | None`` too."""
    for each in (hint, *(get_args(hint) if get_origin(hint) in (Union, types.UnionType) else ())):
        found = each.__metadata__ if get_origin(each) is Annotated else ()
        if (marked := next((one for one in found if isinstance(one, mark)), None)) is not None:
            return marked
    return None


def _group(hint: Any, default: Any) -> type | None:
    """Return the dataclass that a hint stands for, ``Prior`` of ``Prior | None``; None for a single value."""
    if is_dataclass(default) and not isinstance(default, type):
        return type(default)
    bare = _bare(hint)
    variants = get_args(bare) if get_origin(bare) in (Union, types.UnionType) else (bare,)
    return next((each for each in map(_bare, variants) if is_dataclass(each) and isinstance(each, type)), None)
