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

from dataclasses import dataclass
from pathlib import Path

from aerial_il.cli.configuration.keys import MISSING, key
from aerial_il.core import registry
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.specs import image_name

VIEWS = {"rrd": ((".rrd",), "flights.rrd"), "mcap": ((".mcap", ""), "mcap")}  # to be looked at; not read again
FIRST = ("lerobot", "robomimic")  # of several formats of an ending


def _written() -> dict[str, tuple[tuple[str, ...], str]]:
    """Return format -> endings of ``out``, and its name where none is said."""
    forms = {name: registry.module("format", name) for name in (*FIRST, *registry.names("format"))}
    return {name: (form.ENDINGS, form.OWN_NAME) for name, form in forms.items() if hasattr(form, "write")} | VIEWS


FORMS = _written()


@dataclass
class Config:
    path: str = key(MISSING, "dataset of recordings", position=0)
    out: str | None = key(None, "where it goes; derived/ inside the dataset by default")
    format: str | None = key(None, f"{', '.join(FORMS)} (null: as out= ends, lerobot where it has no ending of theirs)")
    cameras: list[str] | None = key(None, "cameras to include (null: all that were recorded; []: states alone)")
    progress: bool = key(True, "show a progress bar")

    def __post_init__(self) -> None:
        if self.format is not None and self.format not in FORMS:
            raise InvalidValueError(f"format={self.format} is not one of {', '.join(FORMS)}.")
        ending, (own, _) = Path(self.out or "").suffix, FORMS[self.form]
        foreign = {known for endings, _ in FORMS.values() for known in endings} - {*own, ""}
        if self.out and (ending in foreign or ("" not in own and ending not in own)):
            wanted = " or ".join(own) if "" not in own else "in no ending of another format"
            raise InvalidValueError(f"out={self.out} with format={self.form}: its name must end in {wanted}.")

    @property
    def form(self) -> str:
        """The format: as it was said, or as ``out`` ends."""
        known = {ending: name for name, (endings, _) in reversed(FORMS.items()) for ending in endings if ending}
        return self.format or known.get(Path(self.out or "").suffix, FIRST[0])


def run(config: Config) -> None:
    """Convert, and say where the result lies."""
    if config.form == "rrd":
        _to_rerun(config)
    elif config.form == "mcap":
        _to_views(config)
    else:
        _to_format(config)


def _to_format(config: Config) -> None:
    from aerial_il.core.progress import Progress
    from aerial_il.data.dataset import open_dataset
    from aerial_il.suite.faces.gymnasium_ids import known_spec

    out, form = _own_place(config), registry.module("format", config.form)
    names = [] if not getattr(form, "PICTURES", True) else _fields(config)
    dataset = open_dataset(config.path, cameras=names)
    spec = dataset.spec
    recorded = [field.name for field in spec.observation.of_group("image")]
    for name in names if isinstance(names, list) else ():
        if name not in recorded:
            hint = "Record it with: aerial-il collect cameras=[...]"
            raise UnknownNameError("recorded camera", name, recorded, hint)
    if not (hasattr(form, "is_current") and form.is_current(dataset, out)):
        episodes = Progress(dataset, desc="convert", unit="ep", disable=not config.progress)
        form.write(episodes, out, env_spec=known_spec(spec.robot, spec.task))
    print(f"{config.form}: {out}")


def _fields(config: Config) -> bool | list[str]:
    return True if config.cameras is None else [*map(image_name, config.cameras)]


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

    out, dataset = _own_place(config), open_dataset(config.path, cameras=_fields(config))
    alone = out.suffix == ".mcap"
    if alone and len(dataset) > 1:
        hint = f"Name one of them, or a folder: aerial-il convert {config.path} format=mcap out={out.with_suffix('')}"
        raise InvalidValueError(f"out={out} holds one flight, and {config.path} has {len(dataset)}. {hint}")
    for episode in Progress(dataset, desc="convert", unit="ep", disable=not config.progress):
        write_view(episode, out if alone else out / f"{plain(episode.uid)}.mcap")
    print(f"For Foxglove, RViz and rerun: {out}")


def _own_place(config: Config) -> Path:
    if config.out is None and Path(config.path).is_file():
        raise InvalidValueError(f"{config.path} is one file: say where its other form goes, out=NAME.")
    return Path(config.out or Path(config.path) / "derived" / FORMS[config.form][1])
