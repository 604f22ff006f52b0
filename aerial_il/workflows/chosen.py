"""A choice of policy or algorithm: settings themselves, a name, or a mapping with a name and what differs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from aerial_il import algorithms, policies
from aerial_il.core.composition import build
from aerial_il.core.errors import UnknownNameError

REGISTERED = {
    "algorithm": (algorithms.names, algorithms.get),
    "policy": (policies.names, policies.get),
}
USUAL = {"algorithm": "bc", "policy": "mlp"}
CONF = Path(__file__).resolve().parents[2] / "conf"


def names(kind: str) -> tuple[str, ...]:
    """Return what may be chosen, without importing any of it: what is registered, and files of differences."""
    return tuple(sorted({*REGISTERED[kind][0](), *(file.stem for file in (CONF / kind).glob("*.yaml"))}))


def chosen(kind: str, value: Any) -> Any:
    """Return the settings that ``value`` stands for; the module of the choice is imported."""
    value = {"name": value} if isinstance(value, str) else value
    if not isinstance(value, Mapping):
        return value
    name, changes = value.get("name", USUAL[kind]), {key: each for key, each in value.items() if key != "name"}
    if name not in names(kind):
        raise UnknownNameError(kind, name, names(kind))
    file = CONF / kind / f"{name}.yaml"
    said = yaml.safe_load(file.read_text(encoding="utf-8")) if file.is_file() else {}
    settings = REGISTERED[kind][1](said.pop("name", name))
    base = build(settings, said, at=f"{kind}.")
    return build(settings, changes, base=base, at=f"{kind}.") if changes else base
