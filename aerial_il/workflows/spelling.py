"""Settings in words of the command line: quoted for Hydra, so that text is taken as it stands, and for a shell."""

import json
import re
import shlex
from collections.abc import Collection, Iterable, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

from aerial_il.core import presets, registry, schema
from aerial_il.core.composition import chosen, dotted, plain

_PLAIN = re.compile(r"(?!(?:true|false|null|inf|nan)$)[a-z_/][a-z0-9_/.\-]*", re.ASCII | re.IGNORECASE)
_QUOTED = re.compile(r"'(?:\\.|[^'\\])*'|\"(?:\\.|[^\"\\])*\"", re.DOTALL)
_BRACKETED = re.compile(r"\[[^\]]*\]|\{[^}]*\}|\([^)]*\)")


def command_line(words: Iterable[str]) -> str:
    """Return ``aerial-il`` and its words as one line that a shell takes apart into these very words."""
    return shlex.join(["aerial-il", *words])


def path(key: str, place: str) -> str:
    """Return ``key=place`` such that ``place`` is not taken for a preset of that key, or for nothing."""
    return f"{key}=./{place}" if place == "null" or place in presets.names(key) else f"{key}={place}"


def words_of(settings: Any, *, without: Collection[str] = ()) -> list[str]:
    """Return the shortest words that lead to ``settings``: what differs from the defaults.

    Args:
        settings: a dataclass. without: keys that are left unsaid.
    """
    words = list[str]()
    for key in schema.keys(type(settings)):
        if "." in key.name or key.name in without or not hasattr(settings, key.name):  # presets, from=
            continue
        value = getattr(settings, key.name)
        if key.takes == "choice":
            words += _choosing(key.name, key.kind, chosen(key.kind, value), key.default)
        elif is_dataclass(value) and not isinstance(value, type):
            words += _group(key.name, value)
        elif schema.shown(value) != key.default:
            words.append(path(key.name, value) if isinstance(value, str) else f"{key.name}={typed(value)}")
    return words


def _choosing(key: str, kind: str, settings: Any, default: str) -> list[str]:
    """Return how ``settings`` are chosen: by the name or the preset that is nearest, and what differs from it."""
    own = registry.name_of(kind, type(settings))
    near = [name for name in presets.names(kind) if presets.read(kind, name).get("name", name) == own]
    ways = []
    for name in sorted({own, *near}, key=lambda each: each != default):
        before, now = (dotted(plain(each)) for each in (chosen(kind, name), settings))
        changes = [
            f"{key}.{k}={v if isinstance(v, str) else typed(v)}" for k, v in now.items() if before.get(k, ...) != v
        ]
        ways.append(([] if name == default else [f"{key}={name}"]) + changes)
    return min(ways, key=len)


def _group(key: str, group: Any) -> list[str]:
    """Return what a group of settings differs in; its path stands for the group."""
    own = {f.name: getattr(group, f.name) for f in fields(group)}
    changes = {f.name: own[f.name] for f in fields(group) if own[f.name] != f.default}
    return [path(key, v) if k == "path" else f"{key}.{k}={typed(v)}" for k, v in changes.items()]


def literal(text: str) -> str:
    """Return an override's value that Hydra and OmegaConf read back as ``text`` itself, whatever it holds.

    Quotes, backslashes before them and what OmegaConf would interpolate are escaped; numbers and ``null`` stay text.
    """
    return text if _PLAIN.fullmatch(text) else "'" + re.sub(r"(\\*)('|$)", _guarded, _uninterpolated(text)) + "'"


def is_quoted(text: str) -> bool:
    """Whether ``text`` stands in quotes as a whole."""
    return _QUOTED.fullmatch(text) is not None


def parts(value: str) -> list[str]:
    """Return what stands between the commas of ``value``, those within quotes and brackets left alone."""
    blank = value
    for pattern in (_QUOTED, _BRACKETED):
        blank = pattern.sub(lambda match: "_" * len(match[0]), blank)
    ends = [i for i, letter in enumerate(blank) if letter == ","]
    return [value[first:last] for first, last in zip([0, *(i + 1 for i in ends)], [*ends, len(value)], strict=True)]


def typed(value: Any) -> str:
    """Return a value as it is typed: without quotes where its strings are plain words."""
    if isinstance(value, str):
        return value if re.fullmatch(r"[\w./+-]*", value, re.ASCII) else literal(value)
    if isinstance(value, list | tuple):
        return "[" + ",".join(map(typed, value)) + "]"
    if isinstance(value, Mapping):
        return "{" + ",".join(f"{name}:{typed(inner)}" for name, inner in value.items()) + "}"
    return json.dumps(value)


def _uninterpolated(text: str) -> str:
    """Return ``text`` such that OmegaConf does not take ``${...}`` within it for a reference."""
    return re.sub(r"(\\*)\$\{", lambda match: f"{match[1] * 2}\\${{", text)


def _guarded(match: re.Match[str]) -> str:
    return match[1] * 2 + ("\\'" if match[2] else "")
