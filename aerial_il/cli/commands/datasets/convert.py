"""Derive a LeRobot v3 dataset from recordings, which lerobot itself opens and trains on.

Every recorded camera becomes a video. An up-to-date conversion is left as it is.

Example: aerial-il convert datasets/pick
Example: aerial-il convert datasets/pick cameras=[wrist] out=datasets/pick_wrist
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from aerial_il.cli.configuration.keys import MISSING, key


@dataclass
class Config:
    path: str = key(MISSING, "dataset of recordings", position=0)
    out: str | None = key(None, "folder of the LeRobot dataset; derived/lerobot inside the dataset by default")
    cameras: list[str] | None = key(None, "cameras to include (null: all that were recorded; []: states alone)")
    progress: bool = key(True, "show a progress bar")


def run(config: Config) -> None:
    """Convert, and say where the result lies."""
    from aerial_il.data.formats.lerobot import DEFAULT_OUT, convert_to_lerobot

    os.environ.setdefault("SVT_LOG", "1")  # the video encoder reports every setting otherwise
    out = Path(config.out or Path(config.path) / DEFAULT_OUT)
    images: bool | tuple[str, ...] = True if config.cameras is None else tuple(f"{name}_rgb" for name in config.cameras)
    if not _is_current(Path(config.path), out, images):
        convert_to_lerobot(config.path, out, cameras=images, progress=config.progress)
    print(f"LeRobot dataset: {out}")


def _is_current(path: Path, out: Path, images: bool | tuple[str, ...]) -> bool:
    """Whether ``out`` is whole and holds just the demonstrations and cameras that a new conversion would."""
    from aerial_il.core.errors import DemoError
    from aerial_il.data.dataset import open_dataset
    from aerial_il.data.formats.lerobot import IMAGES, image_key
    from aerial_il.data.formats.lerobot_import import check_lerobot

    dataset = open_dataset(path)
    if not out.exists():
        return False
    try:
        there = {name for name in check_lerobot(out)["features"] if name.startswith(IMAGES)}
        recorded = tuple(f.name for f in dataset.spec.observation.of_group("image") if f.name.endswith("_rgb"))
        wanted = recorded if isinstance(images, bool) else images
        return there == {image_key(name) for name in wanted} and open_dataset(out).uids == dataset.uids
    except DemoError:
        return False
