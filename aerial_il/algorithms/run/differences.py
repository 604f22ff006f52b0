"""What tells one run from another, in words: settings by their values, contents of which a digest is kept by name."""

import re
from collections.abc import Mapping
from typing import Any

_DIGEST = re.compile(r"[0-9a-f]{64}")
_DEMONSTRATIONS = "dataset.digest"


def differences(before: Mapping[str, Any], now: Mapping[str, Any], *, dataset: str | None = None) -> list[str]:
    """Return one phrase for each setting that differs, its old value and its new one; empty where none does.

    Digests say nothing to anybody, and many follow from other settings (how demonstrations are cut from the policy's
    chunk, say): they are put into words, and only where nothing else differs.

    Args:
        before: dotted key -> value of the run that is there. now: the same, of the one that is asked for.
        dataset: where the demonstrations of the run that is there lay, if it is known.
    """
    keys = [key for key in sorted(before.keys() | now.keys()) if before.get(key) != now.get(key)]
    digests = [key for key in keys if _is_digest(before.get(key)) or _is_digest(now.get(key))]
    said = [key for key in keys if key not in digests]
    if said:
        return [f"{key}: {_shown(before, key)} -> {_shown(now, key)}" for key in said]
    return [_contents(key, before, now, dataset) for key in digests]


def _is_digest(value: Any) -> bool:
    return isinstance(value, str) and _DIGEST.fullmatch(value) is not None


def _shown(settings: Mapping[str, Any], key: str) -> str:
    return repr(settings[key]) if key in settings else "not set"


def _contents(key: str, before: Mapping[str, Any], now: Mapping[str, Any], dataset: str | None) -> str:
    """Say that something has other contents, of which the folder keeps no more than a digest."""
    if key == _DEMONSTRATIONS:
        return f"dataset: the demonstrations of {repr(dataset) if dataset else 'then'} -> others, as many and as long"
    old = "the weights of then" if before.get(key) else "none"
    return f"{key}: {old} -> {'other weights' if now.get(key) else 'none'}"
