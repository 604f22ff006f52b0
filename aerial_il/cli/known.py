"""The keys of a command, those of what is chosen among them; what a choice has is remembered in the user's cache."""

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from aerial_il.core import registry
from aerial_il.core.composition import chosen
from aerial_il.core.errors import UnknownNameError
from aerial_il.core.schema import Key, keys, options

PACKAGE = Path(__file__).resolve().parents[1]
SETTINGS_IN = ("algorithms", "policies", "core", "data")  # folders whose dataclasses choices are made of

FROM_A_RUN = (
    "A policy class is trained anew. To train with the settings of that run: from={0} run=NEW; to go on from its "
    "policy: algorithm=bc_ppo (dapg, residual, jsrl) algorithm.prior={0}; to continue it: its own command again; to "
    "fly it: aerial-il evaluate policy={0} out=OUT"
)


def known(settings: type, said: Mapping[str, list[str]], *, base: Any = None) -> dict[str, Key]:
    """Return name -> key of all that ``settings`` takes.

    Args:
        said: key -> the names that are chosen there, several in a sweep; without them the default's keys are known.
        base: settings whose values are the defaults.

    Raises:
        UnknownNameError: there is no such choice.
    """
    every = {key.name: key for key in keys(settings, base=base)}
    waiting = [key for key in every.values() if key.takes == "choice"]
    while waiting:
        key = waiting.pop()
        for name in said.get(key.name, [] if key.default == "null" else [key.default]):
            for inner in of_choice(key.kind, name):
                new = replace(inner, name=f"{key.name}.{inner.name}")
                every[new.name] = new
                waiting += [new] * (inner.takes == "choice")
    return every


def of_choice(kind: str, name: str) -> list[Key]:
    """Return the keys of the choice ``name``; only where they are not remembered is its module imported.

    Raises:
        UnknownNameError: there is no such choice.
    """
    if name not in options(kind):
        raise not_there(kind, name)
    file = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "aerial_il" / f"{kind}-{name}.json"
    state = _state(kind, name)
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        if content["state"] == state:
            return [Key(**{**each, "options": tuple(each["options"])}) for each in content["keys"]]
    except (OSError, ValueError, LookupError, TypeError):
        pass
    from aerial_il.core.files import write_atomic

    settings = chosen(kind, name)
    own = list(keys(type(settings), base=settings))
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(file, json.dumps({"state": state, "keys": [asdict(key) for key in own]}))
    except OSError:
        pass  # a home that cannot be written to
    return own


def not_there(kind: str, name: str) -> UnknownNameError:
    """Return the error for an unknown choice; for a run in place of a policy class it says what may be meant."""
    known = options(kind)
    meant = FROM_A_RUN.format(name) if kind == "policy" and "/" in name else "" if known else registry.KINDS[kind].hint
    return UnknownNameError(kind, name, known, meant)


def _state(kind: str, name: str) -> list[int | str]:
    """Return what changes with any file in which settings may stand: how many, the newest, and the choice's own."""
    times = [entry.stat().st_mtime_ns for entry in _files(kind)]
    module = registry.place(kind, name)
    spec = find_spec(module) if module else None
    own = spec.origin if spec is not None and spec.origin else ""
    return [len(times), max(times), own, os.stat(own).st_mtime_ns if own else 0]


def _files(kind: str) -> Iterator[Path]:
    from aerial_il.core import presets

    for folder in SETTINGS_IN:
        yield from (PACKAGE / folder).rglob("*.py")
    yield from (presets.folder() / kind).glob("*.yaml")
