"""LeRobot v3, the folder with ``meta/info.json``: its columns are listed in :mod:`.parts.lerobot.writing`.

What it is read and written with takes a while to import.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from aerial_il.core.errors import DemoError
from aerial_il.core.lerobot_names import IMAGES
from aerial_il.data.episode import Episode
from aerial_il.data.source import Source, Wanted

if TYPE_CHECKING:
    from aerial_il.data.dataset import Dataset

ENDINGS, OWN_NAME = ("",), "lerobot"
PARTS = ("meta/**/*", "data/**/*", "videos/**/*")
README, PAGE = "README.md", "card.html"  # beside these, written by aerial-il card


def recognises(path: Path) -> bool:
    return (path / "meta" / "info.json").is_file()


def read(path: Path, wanted: Wanted) -> Source:
    from aerial_il.data.formats.parts.lerobot import reading

    return reading.read(path)


def write(episodes: Iterable[Episode], out: Path, *, env_spec: str | None = None) -> Path:
    from aerial_il.data.formats.parts.lerobot import writing

    return writing.write(episodes, out)


def is_current(dataset: Dataset, out: Path) -> bool:
    """Whether ``out`` is whole and holds just the demonstrations of ``dataset``, and the cameras it was opened with."""
    from aerial_il.data.formats.parts.lerobot import reading, writing
    from aerial_il.data.formats.parts.lerobot.files import check_lerobot
    from aerial_il.data.formats.parts.lerobot.states import PROVENANCE

    made = out / PROVENANCE
    if not made.exists() or any(file.stat().st_mtime_ns > made.stat().st_mtime_ns for file in dataset.files.values()):
        return False  # what was recorded, or written anew as by a relabelling, since
    try:
        there = {name for name in check_lerobot(out)["features"] if name.startswith(IMAGES)}
        first = dataset[0]
        wanted = {writing.image_key(name) for name in writing.colour_cameras(first.spec) if name in first.obs}
        return there == wanted and tuple(reading.read(out).raw) == dataset.uids
    except DemoError:
        return False


def features_of(path: Path) -> list[str]:
    """Return the names of a dataset's features."""
    from aerial_il.data.formats.parts.lerobot.files import check_lerobot

    return [*check_lerobot(path)["features"]]


def altered(path: Path) -> list[Path]:
    from aerial_il.data.formats.parts.lerobot import files

    return files.altered_files(path)
