"""Quote what people type: for Hydra, so that a path is taken as it stands, and for a shell, to be pasted."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable

_PLAIN = re.compile(r"(?!(?:true|false|null|inf|nan)$)[a-z_/][a-z0-9_/.\-]*", re.ASCII | re.IGNORECASE)
_SWEEP = re.compile(r"(choice|range|glob|interval|shuffle|sort|tag)\(")
_QUOTED = re.compile(r"'(?:\\.|[^'\\])*'|\"(?:\\.|[^\"\\])*\"", re.DOTALL)
_BRACKETED = re.compile(r"\[[^\]]*\]|\{[^}]*\}|\([^)]*\)")


def literal(text: str) -> str:
    """Return an override's value that Hydra and OmegaConf read back as ``text`` itself, whatever it holds.

    Quotes, backslashes before them and what OmegaConf would interpolate are escaped; numbers and ``null`` stay text.
    """
    return text if _PLAIN.fullmatch(text) else "'" + re.sub(r"(\\*)('|$)", _guarded, uninterpolated(text)) + "'"


def uninterpolated(text: str) -> str:
    """Return ``text`` such that OmegaConf does not take ``${...}`` within it for a reference."""
    return re.sub(r"(\\*)\$\{", lambda found: f"{found[1] * 2}\\${{", text)


def literals(values: str) -> str:
    """Return a sweep over texts, separated by commas that stand outside of quotes and brackets, as Hydra reads them.

    A part that is quoted already, and a sweep by a function such as ``glob(...)``, is left as it is.
    """
    if _SWEEP.match(values):
        return values
    return ",".join(part if _QUOTED.fullmatch(part) else literal(part) for part in parts(values))


def mapping(value: str) -> str:
    """Return ``{key:text,...}`` with every text quoted that is not."""
    entries = (entry.partition(":") for entry in parts(value.removeprefix("{").removesuffix("}")))
    texts = (f"{key}:{text if _QUOTED.fullmatch(text) else literal(text)}" for key, _, text in entries)
    return "{" + ",".join(texts) + "}"


def is_sweep(value: str) -> bool:
    """Whether Hydra takes ``value`` for several values."""
    return len(parts(value)) > 1 or bool(_SWEEP.match(value))


def parts(value: str) -> list[str]:
    """Return what stands between the commas of ``value``, those within quotes and brackets left alone."""
    blank = value
    for pattern in (_QUOTED, _BRACKETED):
        blank = pattern.sub(lambda found: "_" * len(found[0]), blank)
    ends = [i for i, letter in enumerate(blank) if letter == ","]
    return [value[first:last] for first, last in zip([0, *(i + 1 for i in ends)], [*ends, len(value)], strict=True)]


def command_line(words: Iterable[str]) -> str:
    """Return ``aerial-il`` and its words as one line that a shell takes apart into these very words."""
    return shlex.join(["aerial-il", *words])


def _guarded(found: re.Match[str]) -> str:
    return found[1] * 2 + ("\\'" if found[2] else "")
