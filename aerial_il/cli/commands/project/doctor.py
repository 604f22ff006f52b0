"""Say what works on this machine: versions, cores, rendering, free disk space.

Example: aerial-il doctor
"""

from dataclasses import dataclass
from typing import Any

from aerial_il.cli.as_json import AsJson
from aerial_il.workflows.doctor import PAGE, Doctor, advice, findings


@dataclass(frozen=True, kw_only=True)
class Shown(AsJson, Doctor):
    """How it is shown."""


SETTINGS = Shown


def run(settings: Shown) -> None:
    """Print the findings."""
    result = findings()
    settings.show(result, lambda: _as_text(result))


def _as_text(result: dict[str, Any]) -> str:
    lines = []
    for name, value in result.items():
        inner = value if isinstance(value, dict) else {"": value}
        lines += [f"{' '.join(filter(None, (name, key))):<24} {text}" for key, text in inner.items()]
    notes = advice(result)
    lines += ["", *(f"{name}: {text}" for name, text in notes.items())] if notes else []
    return "\n".join([*lines, "", f"Each finding is explained in {PAGE}."])
