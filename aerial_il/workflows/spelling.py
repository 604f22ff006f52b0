"""Settings in words of the command line: quoted for Hydra, so that text is taken as it stands, and for a shell."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterable, Mapping
from typing import Any

from aerial_il.core import presets

_PLAIN = re.compile(r"(?!(?:true|false|null|inf|nan)$)[a-z_/][a-z0-9_/.\-]*", re.ASCII | re.IGNORECASE)
_QUOTED = re.compile(r"'(?:\\.|[^'\\])*'|\"(?:\\.|[^\"\\])*\"", re.DOTALL)
_BRACKETED = re.compile(r"\[[^\]]*\]|\{[^}]*\}|\([^)]*\)")


def command_line(words: Iterable[str]) -> str:
    """Return ``aerial-il`` and its words as one line that a shell takes apart into these very words."""
    return shlex.join(["aerial-il", *words])


def path(key: str, place: str) -> str:
    """Return ``key=place`` such that ``place`` is not taken for a preset of that key, or for nothing."""
    return f"{key}=./{place}" if place == "null" or place in presets.names(key) else f"{key}={place}"


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
        blank = pattern.sub(lambda found: "_" * len(found[0]), blank)
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
    return re.sub(r"(\\*)\$\{", lambda found: f"{found[1] * 2}\\${{", text)


def _guarded(found: re.Match[str]) -> str:
    return found[1] * 2 + ("\\'" if found[2] else "")
