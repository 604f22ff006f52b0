"""Derive another form of recordings: LeRobot v3, robomimic's or D4RL's HDF5, or a file for the rerun viewer.

The form is that of the ending of out=: .hdf5 is robomimic's, .rrd is rerun's, a folder is LeRobot's; format= says
otherwise. Every recorded camera becomes a video, or images. An up-to-date LeRobot dataset is left as it is.

Example: aerial-il convert datasets/pick
Example: aerial-il convert datasets/pick cameras=[wrist] out=datasets/pick_wrist
Example: aerial-il convert datasets/pick out=pick.hdf5
Example: aerial-il convert datasets/pick format=d4rl out=pick_flat.hdf5
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from aerial_il.cli.configuration.keys import MISSING, key
from aerial_il.core.errors import InvalidValueError

ENDINGS = {"lerobot": ("",), "robomimic": (".hdf5", ".h5"), "d4rl": (".hdf5", ".h5"), "rrd": (".rrd",)}
OWN_NAME = {"robomimic": "robomimic.hdf5", "d4rl": "d4rl.hdf5", "rrd": "flights.rrd"}


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
        if self.out and (ending in foreign or (own != ("",) and ending not in own)):
            wanted = " or ".join(own) if own != ("",) else "in no ending of another format"
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
    else:
        _to_hdf5(config)


def _to_lerobot(config: Config) -> None:
    from aerial_il.data.formats.lerobot import DEFAULT_OUT, convert_to_lerobot

    os.environ.setdefault("SVT_LOG", "1")  # the video encoder reports every setting otherwise
    out = Path(config.out or Path(config.path) / DEFAULT_OUT)
    images: bool | tuple[str, ...] = True if config.cameras is None else tuple(f"{name}_rgb" for name in config.cameras)
    if not _is_current(Path(config.path), out, images):
        convert_to_lerobot(config.path, out, cameras=images, progress=config.progress)
    print(f"LeRobot dataset: {out}")


def _to_hdf5(config: Config) -> None:
    from aerial_il.core.progress import Progress
    from aerial_il.data.dataset import open_dataset
    from aerial_il.data.formats.hdf5 import convert_to_hdf5
    from aerial_il.data.formats.transitions import convert_to_d4rl

    cameras = config.cameras if config.form == "robomimic" else []  # D4RL's are numbers alone
    dataset = open_dataset(config.path, cameras=True if cameras is None else [f"{name}_rgb" for name in cameras])
    read = list(Progress(dataset, desc="convert", unit="ep", disable=not config.progress))
    write = convert_to_hdf5 if config.form == "robomimic" else convert_to_d4rl
    print(f"{config.form}: {write(read, _own_place(config))}")


def _to_rerun(config: Config) -> None:
    from aerial_il.cli.commands.flying import inspect

    out = _own_place(config)
    out.parent.mkdir(parents=True, exist_ok=True)
    inspect.run(inspect.Config(config.path, save=str(out), tier=inspect.TierName("calm")))


def _own_place(config: Config) -> Path:
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
        recorded = tuple(f.name for f in dataset.spec.observation.of_group("image") if f.name.endswith("_rgb"))
        wanted = recorded if isinstance(images, bool) else images
        return there == {image_key(name) for name in wanted} and open_dataset(out).uids == dataset.uids
    except DemoError:
        return False
