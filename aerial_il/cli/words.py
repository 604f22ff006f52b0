"""What was typed, checked against the keys that there are and made into overrides as Hydra reads them.

A path, and whatever else is text, is taken as it stands, commas, quotes and ``$`` included. Only in a sweep do commas
part values; there a path with a comma is put in quotes that the shell leaves: ``dataset="'a,b',c"``.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from aerial_il.cli.commands import Command
from aerial_il.cli.known import known, not_there
from aerial_il.core import presets
from aerial_il.core.composition import base_of
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.schema import FROM, Key, keys, options, unknown_key
from aerial_il.workflows.spelling import is_quoted, literal, parts

SWEEP, SHOW = ("-m", "--multirun"), "--cfg"
FLAGS = (*SWEEP, SHOW, "--help")
LAUNCHER, SWEEPER = "launcher", "sweeper"
_NAME = re.compile(r"[\w.]+", re.ASCII)
_NAMES = re.compile(r"[A-Za-z_][\w/.-]*(,[A-Za-z_][\w/.-]*)*|(glob|choice)\(.*\)", re.ASCII)
_FUNCTION = re.compile(r"(choice|range|glob|interval|shuffle|sort|tag)\(")
_GLOB, _CHOICE = re.compile(r"glob\((.*)\)"), re.compile(r"choice\((.*)\)")


@dataclass(frozen=True)
class Typed:
    """Words as Hydra reads them.

    Attributes:
        overrides: ``key=value``. sweeps: whether several values were asked for. shows: whether the settings are to be
            printed, instead of being run.
        apart: ``launcher`` and ``sweeper`` -> what was said of them, key -> value.
        earlier: the settings that ``from`` names; None where nothing does.
    """

    overrides: tuple[str, ...]
    sweeps: bool = False
    shows: bool = False
    apart: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    earlier: Any = None


def read(command: Command, words: list[str]) -> Typed:
    """Return what ``words`` say: flags, ``key=value``, and bare values in the places of keys.

    Raises:
        UnknownNameError: an unknown flag, key or choice. InvalidValueError: a word that is none of them.
    """
    own, flags, pairs, bare = _own(command), list[str](), list[tuple[str, str]](), list[str]()
    apart: dict[str, dict[str, str]] = {LAUNCHER: {}, SWEEPER: {}}
    for word in words:
        name, equals, value = word.lstrip("+").partition("=")
        first = name.partition(".")[0]
        if word.startswith("--") and word[2:] in own:
            pairs.append((word[2:], "true"))
        elif word.startswith("~"):  # takes an entry out of a mapping
            pairs.append((word[1:].partition("=")[0], "null"))
        elif word.startswith("-"):
            flags.append(_flag(command, word))
        elif flags[-1:] == [SHOW] and word == "job":
            continue
        elif equals and first in apart and first not in own:
            apart[first][name] = value
        elif equals and _NAME.fullmatch(name) and (first in own or not _is_there(word)):
            pairs.append((name, value))  # a bare path may hold an equals sign, as folders of sweeps do
        else:
            bare.append(word)
    pairs += _placed(command, bare)
    if any("\0" in value for _, value in pairs):
        raise InvalidValueError("A value has a null character, which no name and no path can have.")
    sweeps = not set(SWEEP).isdisjoint(flags)
    named = (each for each in pairs if _NAMES.fullmatch(each[1]))
    base = base_of(command.settings, dict(pairs).get(FROM), {*dict(pairs)})
    there = known(command.settings, _choices(command, named, sweeps), base=base)
    overrides = tuple(_override(_find(command, name, there), name, value, sweeps) for name, value in pairs)
    return Typed(overrides, sweeps, SHOW in flags, apart, base)


def literals(values: str) -> str:
    """Return a sweep over texts, separated by commas that stand outside of quotes and brackets, as Hydra reads them.

    A part that is quoted already, and a sweep by a function such as ``choice(...)``, is left as it is.
    """
    if _FUNCTION.match(values):
        return values
    return ",".join(part if is_quoted(part) else literal(part) for part in parts(values))


def _texts_or_null(values: str) -> str:
    """Return a sweep over texts of which some may be null, which no text is."""
    if _FUNCTION.match(values):
        return values
    return ",".join(part if part == "null" else literals(part) for part in parts(values))


def _own(command: Command) -> set[str]:
    own = {field.name for field in fields(command.settings)} | {*getattr(command.settings, "PRESETS", {})}
    return own | {FROM} if hasattr(command.settings, "like") else own


def _flag(command: Command, word: str) -> str:
    flag = word.partition("=")[0]
    if flag in ("-c", SHOW):
        return SHOW
    if word in FLAGS:
        return word
    shown = f"{SHOW} job prints the settings, -m sweeps; settings are said as key=value. {command.hint}"
    raise UnknownNameError("option", word, FLAGS, shown)


def _is_there(path: str) -> bool:
    try:
        return Path(path).exists()
    except (OSError, ValueError):  # too long for a name, or no text that a name could be
        return False


def _placed(command: Command, bare: list[str]) -> list[tuple[str, str]]:
    """Return bare words under the keys in whose places they stand; a key of several takes all that are left."""
    several = {key.name for key in keys(command.settings) if key.takes == "texts"}
    placed, left = list[tuple[str, str]](), list(bare)
    for name in command.bare:
        if name in several and left:
            return [*placed, (name, _list(left))]
        placed += [(name, left.pop(0))] if left else []
    if left:
        raise InvalidValueError(f"{left[0]!r} is not KEY=VALUE. {command.hint}")
    return placed


def _list(values: list[str]) -> str:
    return "[" + ",".join(literal(value) for value in values) + "]"


def _choices(command: Command, pairs: Iterable[tuple[str, str]], sweeps: bool) -> dict[str, list[str]]:
    """Return key -> the names that are said there, several in a sweep."""
    names = dict[str, list[str]]()
    for name, value in pairs:
        name, inner = name.removesuffix(".name"), _CHOICE.fullmatch(value)
        if glob := _GLOB.fullmatch(value):
            key = known(command.settings, names).get(name)
            names[name] = [each for each in options(key.kind) if fnmatch(each, glob[1])] if key and key.kind else []
        else:
            names[name] = (inner[1] if inner else value).split(",") if sweeps else [value]
    return names


def _find(command: Command, name: str, there: Mapping[str, Key]) -> Key:
    """Return the key that ``name`` says, a whole group or an entry of a mapping too."""
    if name in there:
        return there[name]
    head, _, last = name.rpartition(".")
    if last == "name" and head in there and there[head].takes in ("choice", "place"):
        return Key(name, "", "", "text")
    within = any(key.takes == "mapping" and name.startswith(f"{each}.") for each, key in there.items())
    if within or any(each.startswith(f"{name}.") for each in there):
        return Key(name, "", "")
    raise unknown_key(name, there, command.hint)


def _override(key: Key, name: str, value: str, sweeps: bool) -> str:
    quoted = literals if sweeps else literal
    if value == "null" and key.nullable:
        return f"{name}=null"
    if key.takes == "choice" and value[:1] != "{":
        return f"{name}.name={_chosen(key, value, sweeps)}"
    if key.takes == "preset":
        return f"{name}={_chosen(key, value, sweeps)}"
    if key.takes == "place":
        few = presets.names(name)
        return f"{name}.{'name' if all(part in few for part in parts(value)) else 'path'}={quoted(value)}"
    if key.takes == "text":
        return f"{name}={_texts_or_null(value) if sweeps and key.nullable else quoted(value)}"
    if key.takes == "texts" and value[:1] + value[-1:] != "[]":
        return f"{name}={_list([value])}"
    if key.takes == "texts" and "=" in value and not sweeps:  # which Hydra reads in no list
        return f"{name}=[{literals(value[1:-1])}]"
    if key.takes == "mapping" and value[:1] + value[-1:] == "{}":
        return f"{name}={_mapping(value)}"
    return f"{name}={value}"


def _chosen(key: Key, value: str, sweeps: bool) -> str:
    """Return a choice, or several of them in a sweep, once each is known to be there."""
    few = options(key.kind)
    if glob := _GLOB.fullmatch(value):
        return ",".join(each for each in few if fnmatch(each, glob[1]))
    if "$" in value or _FUNCTION.match(value):
        return value
    for part in parts(value) if sweeps else [value]:
        if part not in few:
            raise not_there(key.kind, part)
    return value


def _mapping(value: str) -> str:
    """Return ``{key:text,...}`` with every text quoted that is not."""
    entries = (entry.partition(":") for entry in parts(value.removeprefix("{").removesuffix("}")))
    texts = (f"{key}:{text if is_quoted(text) or not _is_text(text) else literal(text)}" for key, _, text in entries)
    return "{" + ",".join(texts) + "}"


def _is_text(value: str) -> bool:
    return value[:1] not in ("{", "[") and not re.fullmatch(r"[-+]?[\d.]+(e[-+]?\d+)?|true|false|null", value, re.I)
