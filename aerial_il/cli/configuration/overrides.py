"""Check what was typed before Hydra sees it, so that a wrong name is answered with the right one."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import Field, fields, is_dataclass
from pathlib import Path
from typing import Any, get_type_hints

from aerial_il.cli.commands import Command
from aerial_il.cli.configuration import groups, keys
from aerial_il.cli.configuration.flags import TAKES_VALUE, check_flag, check_last, sweeps
from aerial_il.cli.configuration.quoting import is_sweep, literal, literals, mapping
from aerial_il.cli.configuration.spelling import flat
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.renamed import moved

_PLAIN = re.compile(r"[\w.\-]+")
_COMPOSED = re.compile(r"[+-]")
_NAME = re.compile(r"[\w.@-]+|hydra/.*")
_HYDRA_GROUPS = tuple(
    f"hydra.{name}" for name in ("launcher", "sweeper", "job_logging", "hydra_logging", "help", "env")
)


def prepare(command: Command, words: list[str]) -> list[str]:
    """Return the words for Hydra, paths put where they belong and quoted, and sweeps given their folders.

    A path, and whatever else is text, is taken as it stands, commas, quotes and ``$`` included. Only in a sweep do
    commas part values; there a path with a comma is put in quotes that the shell leaves: ``dataset="'a,b',c"``.

    Args:
        command: the command that they follow.
        words: flags, ``key=value`` overrides and bare values of positional keys, as typed.

    Raises:
        UnknownNameError: an unknown flag, key or group value.
        InvalidValueError: a word that is neither of them.
    """
    if nulls := [word for word in words if "\0" in word]:
        raise InvalidValueError(f"{nulls[0]!r} has a null character, which no name and no path can have.")
    flags, words = _named(command, words)
    chosen = dict(command.choices)
    chosen |= {key: value for key, _, value in [word.partition("=") for word in words] if key in chosen}
    for group in chosen.keys() - {field.name for field in fields(command.config)}:
        _check_fits(group, chosen)
    several, texts = sweeps(flags), _texts(command, chosen)
    words = [word for word in words if not _says_the_usual_nothing(command, word)]
    prepared = [_prepared(command, word, chosen, texts, literals if several else literal) for word in words]
    return flags + prepared + (_sweep_folders(command, prepared) if several else [])


def known_keys(command: Command, chosen: dict[str, str | None]) -> tuple[str, ...]:
    """Return every key that the command takes, given the chosen file of each group."""
    found = []
    hints = get_type_hints(command.config)
    for field in fields(command.config):
        found.append(field.name)
        if is_dataclass(hints[field.name]):
            found += [f"{field.name}.{inner.name}" for inner in fields(hints[field.name])]
    for group, option in chosen.items():
        found.append(group)
        if option in groups.options(group):
            content = groups.read_option(group, str(option))
            prefix = f"{group}." if group in hints or group == "launcher" else ""
            found += [prefix + leaf for leaf in groups.leaf_keys(content) if leaf != "defaults"]
    return tuple(dict.fromkeys(found))


def new_key(old: str, known: Collection[str]) -> str | None:
    """Return what the key ``old``, e.g. ``bench.sac.tau``, is called now among those ``known``; None if nothing."""
    for place, letter in enumerate(old):
        inside = {key.removeprefix(old[: place + 1]) for key in known if key.startswith(old[: place + 1])}
        if letter == "." and (new := moved(old[place + 1 :], inside)):
            return f"{old[: place + 1]}{new}"
    return None


def _named(command: Command, words: list[str]) -> tuple[list[str], list[str]]:
    """Return the flags with their values, which Hydra's parser wants in one piece, and every other word as an override.

    A bare word becomes ``key=value`` by its position, and ``--json`` becomes ``json=true``.
    """
    places = iter(keys.positional(command.config))
    known = {f.name: f for f in fields(command.config)}
    lists: dict[str, list[str]] = {}
    flags: list[str] = []
    named: list[str] = []
    for word in words:
        if word.startswith("--") and word[2:] in known:
            named.append(f"{word[2:]}=true")
            continue
        before = flags[-1] if flags else None
        if word.startswith("-") or before in TAKES_VALUE:
            check_flag(command.name, word, before)
            flags.append(word)
            continue
        bare = _is_bare(word, known)
        name = next(iter(lists), None) or next(places, None) if bare else None
        if bare and name is None:
            raise InvalidValueError(f"{word!r} is not KEY=VALUE. See: aerial-il {command.name} --help")
        if name is not None and keys.takes_many(known[name]):
            lists.setdefault(name, []).append(word)
        else:
            named.append(f"{name}={word}" if bare else word)
    check_last(flags[-1] if flags else None)
    return flags, named + [f"{name}={_list(values)}" for name, values in lists.items()]


def _says_the_usual_nothing(command: Command, word: str) -> bool:
    """Whether ``word`` leaves a group empty that is empty anyway."""
    name, _, value = word.partition("=")
    return value == "null" and name in command.choices and command.choices[name] is None


def _is_bare(word: str, known: Mapping[str, Any]) -> bool:
    """Whether ``word`` is a value without its key; a path may hold an equals sign, as folders of sweeps do."""
    if word.startswith(("+", "~")):
        return False
    name, equals, _ = word.partition("=")
    return not equals or not _NAME.fullmatch(name) or (name not in known and _is_there(word))


def _is_there(path: str) -> bool:
    try:
        return Path(path).exists()
    except (OSError, ValueError):  # too long for a name, or no text that a name could be
        return False


def _list(values: list[str]) -> str:
    return "[" + ",".join(literal(value) for value in values) + "]"


def _prepared(
    command: Command, word: str, chosen: dict[str, str | None], texts: Mapping[str, Any], quoted: Callable[[str], str]
) -> str:
    """Return one override as Hydra takes it: its name checked, a path where it belongs, and what is text ``quoted``."""
    name, equals, value = word.partition("=")
    if name == "hydra/launcher" and value != "basic":
        raise InvalidValueError(f"{word}: jobs of a sweep are started by our own launchers, e.g. launcher=processes.")
    sign = name[: len(name) - len(name.lstrip("+~"))]
    plain_name = name.lstrip("+~").split("@")[0]
    if (not equals and not sign) or re.split(r"[./]", plain_name)[0] == "hydra":
        return _checked_hydra(plain_name, word)
    if sign in ("", "++"):
        _check_key(command, plain_name, chosen)
    elif sign == "+":
        _check_added(command, plain_name, chosen)
    field = {f.name: f for f in fields(command.config)}.get(plain_name)
    if field is not None and keys.takes_path(field) and not _all_options(plain_name, value, chosen):
        name = f"{sign}{plain_name}.path"
    elif field is not None and keys.takes_many(field) and not (value.startswith("[") and value.endswith("]")):
        return f"{sign}{plain_name}={_list([value])}"
    elif field is not None and keys.takes_texts_by_number(command.config, field) and value[:1] + value[-1:] == "{}":
        return f"++{plain_name}={mapping(value)}"  # a number is a key that was not there before
    elif field is not None and keys.takes_composition(field) and (plain_name not in chosen or _COMPOSED.search(value)):
        name = f"{sign}{plain_name}.name"
    elif plain_name in chosen and equals:
        _check_choice(plain_name, value, field)
        if value == "null":  # Hydra leaves a group out by this sign alone
            return f"~{plain_name}"
    usual = texts.get(name.lstrip("+"), False)
    is_text = equals and usual is not False and not (value == "null" and usual is None)
    return f"{name}={quoted(value)}" if is_text else name + equals + value


def _texts(command: Command, chosen: dict[str, str | None]) -> dict[str, Any]:
    """Return ``key -> what it is if nothing is said`` of the keys whose values are text, such as paths."""
    hints, found = get_type_hints(command.config), {}
    for field in fields(command.config):
        if hints[field.name] in (str, str | None):
            found[field.name] = field.default
        if keys.takes_path(field):
            optional = get_type_hints(hints[field.name])["path"] == str | None
            found[f"{field.name}.path"] = None if optional else field.default
    for group, option in chosen.items():
        if option in groups.options(group) and option is not None:
            content, prefix = groups.read_option(group, option), f"{group}." if group in hints else ""
            leaves = ((prefix + key, value) for key, value in flat(content).items())
            found |= {key: value for key, value in leaves if isinstance(value, str) and not key.endswith("_target_")}
    return found


def _check_key(command: Command, name: str, chosen: dict[str, str | None]) -> None:
    known = known_keys(command, chosen)
    inside_known = any(name.startswith(f"{k}.") and k not in chosen and k.count(".") for k in known)
    if name.endswith("._target_"):
        return
    if name not in known and not inside_known and not any(k.startswith(f"{name}.") for k in known):
        if new := new_key(name, known):
            raise InvalidValueError(f"{name} is called {new} now. See: aerial-il {command.name} --help")
        raise UnknownNameError("key", name, _siblings(name, known), f"See: aerial-il {command.name} --help")


def _check_added(command: Command, name: str, chosen: dict[str, str | None]) -> None:
    """Refuse ``+name`` where it would add a key beside those of the command, which nothing reads."""
    first, known = name.partition(".")[0], [*(field.name for field in fields(command.config)), *chosen]
    if first not in known:
        raise UnknownNameError("key", first, dict.fromkeys(known), f"See: aerial-il {command.name} --help")


def _checked_hydra(name: str, word: str) -> str:
    """Return a word of Hydra's own, unless it puts a name where a whole group of settings stands."""
    if name in _HYDRA_GROUPS:
        group, value = name.replace(".", "/"), word.partition("=")[2]
        raise InvalidValueError(f"{word} would have no effect: choose Hydra's groups with {group}={value}.")
    return word


def _check_fits(group: str, chosen: Mapping[str, str | None]) -> None:
    """Refuse a set of values, e.g. ``experiment=quick``, that sets what the chosen file of a group does not have."""
    for name in _parts(group, chosen):
        for other, content in groups.read_option(group, name).items():
            wanted = set(content) if isinstance(content, dict) else set()
            there = {option: groups.read_option(other, option) for option in groups.options(other)}
            lacking = {option: sorted(wanted - set(inside)) for option, inside in there.items()}
            for option in _parts(other, chosen):
                if lacking[option]:
                    keys_lacking = ", ".join(f"{other}.{key}" for key in lacking[option])
                    fitting = ", ".join(option for option, keys in lacking.items() if not keys)
                    raise InvalidValueError(
                        f"{group}={name} sets {keys_lacking}, which {other}={option} does not have. "
                        f"It fits {other}={fitting}."
                    )


def _parts(group: str, chosen: Mapping[str, str | None]) -> list[str]:
    """Return the files of ``group`` that were chosen, several in a sweep."""
    return [part for part in (chosen.get(group) or "").split(",") if part in groups.options(group)]


def _siblings(name: str, known: tuple[str, ...]) -> list[str]:
    """Return the keys that ``name`` may have been meant for: those of its group, else those of its depth."""
    group = name.rpartition(".")[0]
    inside = [k for k in known if k.rpartition(".")[0] == group]
    return inside or [k for k in known if "." not in k]


def _check_choice(group: str, value: str, field: Field[Any] | None) -> None:
    if value.endswith(")") or "$" in value or (value == "null" and (field is None or field.default is None)):
        return
    if value[:1] + value[-1:] in ("[]", "{}", ""):
        raise UnknownNameError(group, value, groups.options(group))
    for part in value.split(","):
        if _PLAIN.fullmatch(part) and part not in groups.options(group):
            raise UnknownNameError(group, part, groups.options(group))


def _all_options(group: str, value: str, chosen: dict[str, str | None]) -> bool:
    return group in chosen and all(part in groups.options(group) for part in value.split(","))


def _sweep_folders(command: Command, words: list[str]) -> list[str]:
    """Name each job's folder by what is swept: ``run/seed=0``, ``run/seed=1``, ..."""
    swept = [name for name, _, value in (w.partition("=") for w in words) if is_sweep(value)]
    target = keys.output_key(command.config)
    if target in swept:
        raise InvalidValueError(f"{target} cannot be swept: each job gets a folder of its own below {target}=FOLDER.")
    parts = [f"{k}=" + (f"${{hydra:runtime.choices.{k}}}" if k in command.choices else f"${{{k}}}") for k in swept]
    folder = ",".join(parts).replace("'", "")
    return [f"hydra.sweep.subdir='{folder or '.'}'"]
