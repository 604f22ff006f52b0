"""Derive another form of recordings: any format that is written, or what viewers show."""

import logging
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from aerial_il.core import registry
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.places import README_SIGN, claim_file, claim_folder
from aerial_il.data.reading import Reading

log = logging.getLogger(__name__)
VIEWS = {"rrd": ((".rrd",), "flights.rrd"), "mcap": ((".mcap", ""), "mcap")}  # to be looked at; not read again
VIEWS_PARTS = ("*.mcap",)  # of a folder of these
FIRST = ("lerobot", "robomimic")  # of several formats of an ending


@cache
def forms() -> dict[str, tuple[tuple[str, ...], str]]:
    """Return format -> endings of ``out``, and its name where none is said."""
    every = {name: registry.module("format", name) for name in (*FIRST, *registry.names("format"))}
    return {name: (form.ENDINGS, form.OWN_NAME) for name, form in every.items() if hasattr(form, "write")} | VIEWS


@dataclass(frozen=True, kw_only=True)
class Convert(Reading):
    """What is converted, and into what.

    Attributes:
        path: dataset of recordings.
        out: where it goes; derived/ inside the dataset by default.
        format: of the result: lerobot, robomimic, d4rl, minari, rrd, mcap, or another of aerial_il/data/formats that
            is written (null: as out= ends, lerobot where it has no ending of theirs).
        cameras: cameras to include (null: all that were recorded; []: states alone).
        progress: show a progress bar.
    """

    path: str
    out: str | None = None
    format: str | None = None
    cameras: tuple[str, ...] | None = None
    progress: bool = True

    def __post_init__(self) -> None:
        if self.format is not None and self.format not in forms():
            raise InvalidValueError(f"format={self.format} is not one of {', '.join(forms())}.")
        ending, (own, _) = Path(self.out or "").suffix, forms()[self.form]
        foreign = {known for endings, _ in forms().values() for known in endings} - {*own, ""}
        if self.out and (ending in foreign or ("" not in own and ending not in own)):
            wanted = " or ".join(own) if "" not in own else "no ending of another format"
            raise InvalidValueError(f"out={self.out} with format={self.form}: its name must end in {wanted}.")

    @property
    def form(self) -> str:
        """The format: as it was said, or as ``out`` ends."""
        known = {ending: name for name, (endings, _) in reversed(forms().items()) for ending in endings if ending}
        return self.format or known.get(Path(self.out or "").suffix, FIRST[0])

    @property
    def images(self) -> bool | list[str]:
        """The images to include, by their fields' names; True for all."""
        from aerial_il.core.specs import image_name

        return True if self.cameras is None else [*map(image_name, self.cameras)]


def convert(settings: Convert) -> Path:
    """Convert, and return where the result lies."""
    if settings.form == "rrd":
        return _to_rerun(settings)
    return _to_views(settings) if settings.form == "mcap" else _to_format(settings)


def _to_format(settings: Convert) -> Path:
    from aerial_il.core.progress import Progress
    from aerial_il.data.dataset import open_dataset
    from aerial_il.suite.faces.gymnasium_ids import known_spec

    out, form = _own_place(settings), registry.module("format", settings.form)
    names = [] if not getattr(form, "PICTURES", True) else settings.images
    dataset = open_dataset(settings.path, **settings.answers, cameras=names)
    spec = dataset.spec
    recorded = [field.name for field in spec.observation.of_group("image")]
    for name in names if isinstance(names, list) else ():
        if name not in recorded:
            hint = "Record it with: aerial-il collect cameras=[...]"
            raise UnknownNameError("recorded camera", name, recorded, hint)
    if not (hasattr(form, "is_current") and form.is_current(dataset, out)):
        episodes = Progress(dataset, desc="convert", unit="ep", disable=not settings.progress)
        form.write(episodes, out, env_spec=known_spec(spec.robot, spec.task))
    return out


def _to_rerun(settings: Convert) -> Path:
    from aerial_il.workflows.inspect import Inspect, inspect

    out = _own_place(settings)
    out.parent.mkdir(parents=True, exist_ok=True)
    made = inspect(Inspect(path=settings.path, save=str(out)))
    log.info("\n".join(made.notes))
    return made.file


def _to_views(settings: Convert) -> Path:
    from aerial_il.core.progress import Progress
    from aerial_il.data.dataset import open_dataset
    from aerial_il.presentation.rerun.geometry import plain
    from aerial_il.presentation.rerun.ros2.view import write_view

    out, dataset = _own_place(settings), open_dataset(settings.path, **settings.answers, cameras=settings.images)
    alone = out.suffix == ".mcap"
    if alone and len(dataset) > 1:
        folder = out.with_suffix("")
        hint = f"Name one of them, or a folder: aerial-il convert {settings.path} format=mcap out={folder}"
        raise InvalidValueError(f"out={out} holds one flight, and {settings.path} has {len(dataset)}. {hint}")
    for episode in Progress(dataset, desc="convert", unit="ep", disable=not settings.progress):
        write_view(episode, out if alone else out / f"{plain(episode.uid)}.mcap")
    return out


def _own_place(settings: Convert) -> Path:
    if settings.out is None and Path(settings.path).is_file():
        raise InvalidValueError(f"{settings.path} is one file: say where its other form goes, out=NAME.")
    out = Path(settings.out or Path(settings.path) / "derived" / forms()[settings.form][1])
    endings, _ = forms()[settings.form]
    if "" not in endings or out.suffix in {*endings} - {""}:
        return claim_file(out)
    if settings.form == "lerobot":
        return claim_lerobot(out)
    parts = VIEWS_PARTS if settings.form in VIEWS else getattr(registry.module("format", settings.form), "PARTS", ())
    return claim_folder(out, parts, parts)


def claim_lerobot(out: Path) -> Path:
    """Return the place of a LeRobot dataset, which may have a card of ours."""
    from aerial_il.data.formats import lerobot

    claim_folder(out, lerobot.PARTS, (*lerobot.PARTS, lerobot.README, lerobot.PAGE))
    claim_file(out / lerobot.PAGE)
    claim_file(out / lerobot.README, sign=README_SIGN)
    return out
