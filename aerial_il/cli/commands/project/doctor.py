"""Say what works on this machine: versions, cores, rendering, free disk space.

Example: aerial-il doctor
"""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from typing import Any

from aerial_il.cli.configuration.keys import key


@dataclass
class Config:
    json: bool = key(False, "print one JSON object (also: --json)")


def run(config: Config) -> None:
    """Print the findings."""
    found = findings()
    print(json.dumps(found, indent=2) if config.json else _as_text(found))


def findings() -> dict[str, Any]:
    """Return versions, machine, the result of rendering one frame with each back end, and free space."""
    from aerial_il.core import rendering
    from aerial_il.core.provenance import provenance

    problems = {backend: rendering.probe_backend(backend) or "works" for backend in rendering.BACKENDS}
    return {
        **provenance(),
        "rendering": {"chosen": rendering.choose_backend() or "MuJoCo's own choice", **problems},
        "free_disk_gb": round(shutil.disk_usage(".").free / 1e9, 1),
    }


def _as_text(found: dict[str, Any]) -> str:
    from aerial_il.core.rendering import PACKAGES, can_render

    lines = []
    for name, value in found.items():
        inner = value if isinstance(value, dict) else {"": value}
        lines += [f"{' '.join(filter(None, (name, key))):<24} {text}" for key, text in inner.items()]
    if not can_render():
        lines.append(f"Cameras and videos are off. To have them: sudo apt-get install -y {PACKAGES}; make setup")
    return "\n".join(lines)
