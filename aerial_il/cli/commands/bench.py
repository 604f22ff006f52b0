"""Run one benchmark, or all of them, and print what they measured.

Each file of conf/bench/ is one: it names a function of the command line's bench_*.py files and its settings.

Example: aerial-il bench experts bench.episodes=50
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from aerial_il.cli import conf
from aerial_il.cli.build import build
from aerial_il.cli.keys import group, key
from aerial_il.cli.tables import table


@dataclass
class Config:
    bench: dict[str, Any] | None = group("which benchmark (null: all, one after the other)", optional=True, position=0)
    json: bool = key(False, "print one JSON object (also: --json)")


def run(config: Config) -> None:
    """Print the measurements."""
    if config.bench is not None:
        found = build(config.bench)
    else:
        found = {name: build(conf.read_option("bench", name)) for name in conf.options("bench")}
    print(json.dumps(found, indent=2) if config.json else as_text(found))


def as_text(found: Mapping[str, Any]) -> str:
    """Lay measurements out: lists of rows as tables, nested results under their name, numbers one to a line."""
    parts = []
    for name, value in found.items():
        if isinstance(value, list) and value and isinstance(value[0], Mapping):
            parts.append(f"{name}\n{table(value)}")
        elif isinstance(value, Mapping):
            parts.append(f"{name}\n{as_text(value)}")
        else:
            parts.append(f"  {name}: {value}")
    return "\n".join(parts)
