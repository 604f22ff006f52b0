"""Derive another form of recordings: LeRobot, robomimic's and D4RL's HDF5, Minari, rerun, views for Foxglove."""

from __future__ import annotations

import os
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from aerial_il.core.errors import InvalidValueError

if TYPE_CHECKING:
    from aerial_il.data.episode import Episode

ENDINGS = {
    "lerobot": ("",),
    "robomimic": (".hdf5", ".h5"),
    "d4rl": (".hdf5", ".h5"),
    "minari": ("",),
    "rrd": (".rrd",),
    "mcap": (".mcap", ""),
}
OWN_NAME = {
    "lerobot": "lerobot",
    "robomimic": "robomimic.hdf5",
    "d4rl": "d4rl.hdf5",
    "minari": "minari/flights-v0",
    "rrd": "flights.rrd",
    "mcap": "mcap",
}


Format = Literal["lerobot", "robomimic", "d4rl", "minari", "rrd", "mcap"]


@dataclass(frozen=True, kw_only=True)
class Convert:
    """What is converted, and into what.

    Attributes:
        path: dataset of recordings.
        out: where it goes; derived/ inside the dataset by default.
        format: of the result (null: as out= ends, lerobot where it has no ending of theirs).
        cameras: cameras to include (null: all that were recorded; []: states alone).
        progress: show a progress bar.
    """

    path: str
    out: str | None = None
    format: Format | None = None
    cameras: tuple[str, ...] | None = None
    progress: bool = True

    def __post_init__(self) -> None:
        ending, own = Path(self.out or "").suffix, ENDINGS[self.form]
        foreign = {known for endings in ENDINGS.values() for known in endings} - {*own, ""}
        if self.out and (ending in foreign or ("" not in own and ending not in own)):
            wanted = " or ".join(own) if "" not in own else "in no ending of another format"
            raise InvalidValueError(f"out={self.out} with format={self.form}: its name must end in {wanted}.")

    @property
    def form(self) -> str:
        """The format: as it was said, or as ``out`` ends."""
        known = {ending: name for name, endings in reversed(ENDINGS.items()) for ending in endings if ending}
        return self.format or known.get(Path(self.out or "").suffix, "lerobot")


def convert(settings: Convert) -> Path:
    """Convert, and return where the result lies."""
    write = {"lerobot": _to_lerobot, "rrd": _to_rerun, "mcap": _to_views, "minari": _to_minari}
    return write.get(settings.form, _to_hdf5)(settings)


def _to_lerobot(settings: Convert) -> Path:
    from aerial_il.data.formats.lerobot import convert_to_lerobot

    os.environ.setdefault("SVT_LOG", "1")  # the video encoder reports every setting otherwise
    out = _own_place(settings)
    images: bool | tuple[str, ...] = (
        True if settings.cameras is None else tuple(f"{name}_rgb" for name in settings.cameras)
    )
    if not _is_current(Path(settings.path), out, images):
        convert_to_lerobot(settings.path, out, cameras=images, progress=settings.progress)
    return out


def _to_hdf5(settings: Convert) -> Path:
    from aerial_il.data.formats.hdf5 import convert_to_hdf5
    from aerial_il.data.formats.transitions import convert_to_d4rl

    read = _episodes(settings, settings.cameras if settings.form == "robomimic" else [])  # D4RL's are numbers alone
    write = convert_to_hdf5 if settings.form == "robomimic" else convert_to_d4rl
    return Path(write(read, _own_place(settings)))


def _to_minari(settings: Convert) -> Path:
    from aerial_il.data.formats.minari_export import convert_to_minari
    from aerial_il.suite.faces.gymnasium_ids import known_spec

    out, read = _own_place(settings), _episodes(settings, settings.cameras)
    spec = read[0].spec
    return Path(convert_to_minari(read, out, env_spec=known_spec(spec.robot, spec.task)))


def _episodes(settings: Convert, cameras: Collection[str] | None) -> list[Episode]:
    from aerial_il.core.progress import Progress
    from aerial_il.data.dataset import open_dataset

    dataset = open_dataset(settings.path, cameras=True if cameras is None else [f"{name}_rgb" for name in cameras])
    return list(Progress(dataset, desc="convert", unit="ep", disable=not settings.progress))


def _to_rerun(settings: Convert) -> Path:
    from aerial_il.workflows.inspect import Inspect, inspect

    out = _own_place(settings)
    out.parent.mkdir(parents=True, exist_ok=True)
    return inspect(Inspect(path=settings.path, save=str(out))).file


def _to_views(settings: Convert) -> Path:
    from aerial_il.core.progress import Progress
    from aerial_il.data.dataset import open_dataset
    from aerial_il.presentation.rerun.geometry import plain
    from aerial_il.presentation.rerun.ros2.view import write_view

    cameras = True if settings.cameras is None else [f"{name}_rgb" for name in settings.cameras]
    out, dataset = _own_place(settings), open_dataset(settings.path, cameras=cameras)
    alone = out.suffix in ENDINGS["mcap"][:1]
    if alone and len(dataset) > 1:
        hint = f"Name one of them, or a folder: aerial-il convert {settings.path} format=mcap out={out.with_suffix('')}"
        raise InvalidValueError(f"out={out} holds one flight, and {settings.path} has {len(dataset)}. {hint}")
    for episode in Progress(dataset, desc="convert", unit="ep", disable=not settings.progress):
        write_view(episode, out if alone else out / f"{plain(episode.uid)}.mcap")
    return out


def _own_place(settings: Convert) -> Path:
    if settings.out is None and Path(settings.path).is_file():
        raise InvalidValueError(f"{settings.path} is one file: say where its other form goes, out=NAME.")
    return Path(settings.out or Path(settings.path) / "derived" / OWN_NAME[settings.form])


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
