"""What was typed, checked against the keys that there are and made into overrides as Hydra reads them.

A path, and whatever else is text, is taken as it stands, commas, quotes and ``$`` included. Only in a sweep do commas
part values; there a path with a comma is put in quotes that the shell leaves: ``dataset="'a,b',c"``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from fnmatch import fnmatch
from pathlib import Path

from aerial_il.cli.commands import Command
from aerial_il.cli.known import FROM_A_RUN, known, not_there
from aerial_il.core import presets
from aerial_il.core.composition import Key, options, unknown_key
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.workflows.spelling import is_quoted, literal, parts

SWEEP, SHOW = ("-m", "--multirun"), "--cfg"
FLAGS = (*SWEEP, SHOW, "--help")
_NAME = re.compile(r"[\w.]+", re.ASCII)
_FUNCTION = re.compile(r"(choice|range|glob|interval|shuffle|sort|tag)\(")
_NAMES = re.compile(r"[A-Za-z_][\w/.-]*(,[A-Za-z_][\w/.-]*)*", re.ASCII)


@dataclass(frozen=True)
class Typed:
    """Words as Hydra reads them.

    Attributes:
        overrides: ``key=value``. sweeps: whether several values were asked for. shows: whether the settings are to be
            printed, instead of being run.
    """

    overrides: tuple[str, ...]
    sweeps: bool = False
    shows: bool = False


def read(command: Command, words: list[str]) -> Typed:
    """Return what ``words`` say: flags, ``key=value`` and bare values.

    Raises:
        UnknownNameError: an unknown flag, key or choice. InvalidValueError: a word that is none of them.
    """
    if nulls := [word for word in words if "\0" in word]:
        raise InvalidValueError(f"{nulls[0]!r} has a null character, which no name and no path can have.")
    flags, named = _parted(command, words)
    sweeps = not set(SWEEP).isdisjoint(flags)
    pairs = [(name.lstrip("+"), value) for name, _, value in (word.partition("=") for word in named)]
    there = known(command.settings, _choices(command, pairs, sweeps))
    return Typed(tuple(_override(command, *pair, there, sweeps) for pair in pairs), sweeps, SHOW in flags)


def is_sweep(value: str) -> bool:
    """Whether Hydra takes ``value`` for several values."""
    return len(parts(value)) > 1 or bool(_FUNCTION.match(value))


def literals(values: str) -> str:
    """Return a sweep over texts, separated by commas that stand outside of quotes and brackets, as Hydra reads them.

    A part that is quoted already, and a sweep by a function such as ``choice(...)``, is left as it is.
    """
    if _FUNCTION.match(values):
        return values
    return ",".join(part if is_quoted(part) else literal(part) for part in parts(values))


def _parted(command: Command, words: list[str]) -> tuple[list[str], list[str]]:
    """Return the flags, and every other word as ``key=value``: a bare one by its place, ``--json`` as ``json=true``."""
    places, bare = iter(command.bare), dict[str, list[str]]()
    switches = {field.name for field in fields(command.settings) if field.type in ("bool", bool)}
    several = {name for name, each in known(command.settings, {}).items() if each.takes == "texts"} if places else set()
    flags, named = list[str](), list[str]()
    for word in words:
        if word.startswith("--") and word[2:] in switches:
            named.append(f"{word[2:]}=true")
        elif word.startswith("-"):
            flags.append(_flag(command, word))
        elif flags[-1:] == [SHOW] and word == "job":
            continue
        elif not _is_bare(command, word):
            named.append(word)
        else:
            last = next(reversed(bare), None)
            name = last if last in several else next(places, None)
            if name is None:
                raise InvalidValueError(f"{word!r} is not KEY=VALUE. {command.hint}")
            bare.setdefault(name, []).append(word)
    return flags, named + [f"{name}={_list(said) if name in several else said[0]}" for name, said in bare.items()]


def _flag(command: Command, word: str) -> str:
    flag = word.partition("=")[0]
    if flag in ("-c", SHOW):
        return SHOW
    if word in FLAGS:
        return word
    shown = f"{SHOW} job prints the settings, -m sweeps; settings are said as key=value. {command.hint}"
    raise UnknownNameError("option", word, FLAGS, shown)


def _is_bare(command: Command, word: str) -> bool:
    """Whether ``word`` is a value without its key; a path may hold an equals sign, as folders of sweeps do."""
    name, equals, _ = word.lstrip("+").partition("=")
    if not equals or not _NAME.fullmatch(name):
        return True
    return name.partition(".")[0] not in _own(command) and _is_there(word)


def _own(command: Command) -> set[str]:
    return {*(field.name for field in fields(command.settings)), *getattr(command.settings, "PRESETS", {})}


def _is_there(path: str) -> bool:
    try:
        return Path(path).exists()
    except (OSError, ValueError):  # too long for a name, or no text that a name could be
        return False


def _list(values: list[str]) -> str:
    return "[" + ",".join(literal(value) for value in values) + "]"


def _choices(command: Command, pairs: list[tuple[str, str]], sweeps: bool) -> dict[str, list[str]]:
    """Return key -> the names that are said there, several in a sweep."""
    found = dict[str, list[str]]()
    for name, value in pairs:
        name, inner = name.removesuffix(".name"), re.fullmatch(r"choice\((.*)\)", value)
        if glob := re.fullmatch(r"glob\((.*)\)", value):
            key = known(command.settings, found).get(name)
            found[name] = [each for each in options(key.kind) if fnmatch(each, glob[1])] if key and key.kind else []
        elif names := _NAMES.fullmatch(inner[1] if inner else value):
            found[name] = names[0].split(",") if sweeps else [value]
    return found


def _override(command: Command, name: str, value: str, there: Mapping[str, Key], sweeps: bool) -> str:
    key, quoted = _find(command, name, there), literals if sweeps else literal
    if value == "null" and key.nullable:
        return f"{name}=null"
    if key.takes == "choice" and value[:1] != "{":
        return f"{name}.name={_chosen(key, value, sweeps)}"
    if key.takes == "preset":
        return f"{name}={_chosen(key, value, sweeps)}"
    if key.takes == "place" and value[:1] != "{":
        few = presets.names(name)
        return f"{name}.{'name' if all(part in few for part in parts(value)) else 'path'}={quoted(value)}"
    if key.takes == "text":
        return f"{name}={quoted(value)}"
    if key.takes == "texts" and value[:1] + value[-1:] != "[]":
        return f"{name}={_list([value])}"
    if key.takes == "mapping" and value[:1] + value[-1:] == "{}":
        return f"{name}={_mapping(value)}"
    return f"{name}={value}"


def _find(command: Command, name: str, there: Mapping[str, Key]) -> Key:
    if name in there:
        return there[name]
    head, _, last = name.rpartition(".")
    if last == "name" and head in there and there[head].takes in ("choice", "place"):
        return Key(name, "", "", "text")
    within = any(key.takes == "mapping" and name.startswith(f"{each}.") for each, key in there.items())
    if within or any(each.startswith(f"{name}.") for each in there):
        return Key(name, "", "")
    if command.name == "train" and name == "from":
        raise InvalidValueError(f"There is no key from. {FROM_A_RUN.format('RUN')}")
    raise unknown_key(name, there, command.hint)


def _chosen(key: Key, value: str, sweeps: bool) -> str:
    """Return a choice, or several of them in a sweep, once each is known to be there."""
    few = options(key.kind)
    if glob := re.fullmatch(r"glob\((.*)\)", value):
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
