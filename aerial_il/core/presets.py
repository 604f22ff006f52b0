"""Presets: the files of ``conf/KIND/NAME.yaml``, each of which says in data what differs from the defaults."""

from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any

from aerial_il.core.errors import UnknownNameError


@cache
def folder() -> Path:
    """Return the folder of presets: beside the code when installed, at the top of a checkout."""
    package = Path(__file__).resolve().parents[1]
    inside = package / "conf"
    return inside if inside.is_dir() else package.parent / "conf"


def names(kind: str) -> tuple[str, ...]:
    """Return the names of all presets of a kind."""
    return tuple(sorted(file.stem for file in (folder() / kind).glob("*.yaml")))


def read(kind: str, name: str) -> dict[str, Any]:
    """Return what the preset ``name`` says.

    Raises:
        UnknownNameError: there is none.
    """
    if name not in names(kind):
        raise UnknownNameError(kind, name, names(kind))
    return deepcopy(_content(folder() / kind / f"{name}.yaml"))


@cache
def _content(file: Path) -> dict[str, Any]:
    import yaml

    return yaml.safe_load(file.read_text(encoding="utf-8")) or {}
