"""Derive another form of recordings: LeRobot v3, robomimic's or D4RL's HDF5, Minari, files for rerun, Foxglove.

The form is that of the ending of out=: .hdf5 is robomimic's, .rrd is rerun's, .mcap is one flight for ROS 2's viewers,
a folder is LeRobot's; format= says otherwise. A dataset of Minari's is a folder named NAME-vN. Every recorded camera
becomes a video, or images. An up-to-date LeRobot dataset is left as it is.

Example: aerial-il convert datasets/pick
Example: aerial-il convert datasets/pick cameras=[wrist] out=datasets/pick_wrist
Example: aerial-il convert datasets/pick out=pick.hdf5
Example: aerial-il convert datasets/pick format=d4rl out=pick_flat.hdf5
Example: aerial-il convert datasets/pick format=minari out=pick-v0
Example: aerial-il convert datasets/pick format=mcap
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from aerial_il.cli.configuration.keys import MISSING, key
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import image_name

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


@dataclass
class Config:
    path: str = key(MISSING, "dataset of recordings", position=0)
    out: str | None = key(None, "where it goes; derived/ inside the dataset by default")
    format: str | None = key(
        None, f"{', '.join(ENDINGS)} (null: as out= ends, lerobot where it has no ending of theirs)"
    )
    cameras: list[str] | None = key(None, "cameras to include (null: all that were recorded; []: states alone)")
    progress: bool = key(True, "show a progress bar")

    def __post_init__(self) -> None:
        if self.format is not None and self.format not in ENDINGS:
            raise InvalidValueError(f"format={self.format} is not one of {', '.join(ENDINGS)}.")
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


def run(config: Config) -> None:
    """Convert, and say where the result lies."""
    if config.form == "lerobot":
        _to_lerobot(config)
    elif config.form == "rrd":
        _to_rerun(config)
    elif config.form == "mcap":
        _to_views(config)
    elif config.form == "minari":
        _to_minari(config)
    else:
        _to_hdf5(config)


def _to_lerobot(config: Config) -> None:
    from aerial_il.data.formats.lerobot import convert_to_lerobot

    os.environ.setdefault("SVT_LOG", "1")  # the video encoder reports every setting otherwise
    out = _own_place(config)
    images: bool | tuple[str, ...] = True if config.cameras is None else tuple(map(image_name, config.cameras))
    if not _is_current(Path(config.path), out, images):
        convert_to_lerobot(config.path, out, cameras=images, progress=config.progress)
    print(f"LeRobot dataset: {out}")


def _to_hdf5(config: Config) -> None:
    from aerial_il.data.formats.hdf5 import convert_to_hdf5
    from aerial_il.data.formats.transitions import convert_to_d4rl

    read = _episodes(config, config.cameras if config.form == "robomimic" else [])  # D4RL's are numbers alone
    write = convert_to_hdf5 if config.form == "robomimic" else convert_to_d4rl
    print(f"{config.form}: {write(read, _own_place(config))}")


def _to_minari(config: Config) -> None:
    from aerial_il.data.formats.minari_export import convert_to_minari
    from aerial_il.suite.faces.gymnasium_ids import known_spec

    out, read = _own_place(config), _episodes(config, config.cameras)
    spec = read[0].spec
    print(f"Minari dataset: {convert_to_minari(read, out, env_spec=known_spec(spec.robot, spec.task))}")


def _episodes(config: Config, cameras: list[str] | None) -> list[Episode]:
    from aerial_il.core.progress import Progress
    from aerial_il.data.dataset import open_dataset

    dataset = open_dataset(config.path, cameras=True if cameras is None else [*map(image_name, cameras)])
    return list(Progress(dataset, desc="convert", unit="ep", disable=not config.progress))


def _to_rerun(config: Config) -> None:
    from aerial_il.cli.commands.flying import inspect

    out = _own_place(config)
    out.parent.mkdir(parents=True, exist_ok=True)
    inspect.run(inspect.Config(config.path, save=str(out), tier=inspect.TierName("calm")))


def _to_views(config: Config) -> None:
    from aerial_il.core.progress import Progress
    from aerial_il.data.dataset import open_dataset
    from aerial_il.presentation.rerun.geometry import plain
    from aerial_il.presentation.rerun.ros2.view import write_view

    cameras = True if config.cameras is None else [*map(image_name, config.cameras)]
    out, dataset = _own_place(config), open_dataset(config.path, cameras=cameras)
    alone = out.suffix in ENDINGS["mcap"][:1]
    if alone and len(dataset) > 1:
        hint = f"Name one of them, or a folder: aerial-il convert {config.path} format=mcap out={out.with_suffix('')}"
        raise InvalidValueError(f"out={out} holds one flight, and {config.path} has {len(dataset)}. {hint}")
    for episode in Progress(dataset, desc="convert", unit="ep", disable=not config.progress):
        write_view(episode, out if alone else out / f"{plain(episode.uid)}.mcap")
    print(f"For Foxglove, RViz and rerun: {out}")


def _own_place(config: Config) -> Path:
    if config.out is None and Path(config.path).is_file():
        raise InvalidValueError(f"{config.path} is one file: say where its other form goes, out=NAME.")
    return Path(config.out or Path(config.path) / "derived" / OWN_NAME[config.form])


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
        recorded = tuple(f.name for f in dataset.spec.observation.fields if f.is_colour)
        wanted = recorded if isinstance(images, bool) else images
        return there == {image_key(name) for name in wanted} and open_dataset(out).uids == dataset.uids
    except DemoError:
        return False
