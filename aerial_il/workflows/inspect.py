"""Flights in rerun: the real scene in motion, its forces and pictures, and every signal on one timeline."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.places import claim_file
from aerial_il.workflows.parts.names import Tier, at_least

if TYPE_CHECKING:
    from aerial_il.data.episode import Episode
    from aerial_il.evaluation.predictions import Prediction
    from aerial_il.presentation.rerun.file import FlightFile
    from aerial_il.presentation.rerun.flight import Flight

INSPECTIONS = "runs/inspections"
METRICS = "metrics.jsonl"  # what a run has and a dataset has not


@dataclass(frozen=True, kw_only=True)
class Inspect:
    """What is looked at, and how.

    Attributes:
        path: a recording, a dataset (ours, LeRobot, HDF5), or the folder of a run.
        beside: what to compare it with: the same kinds, or: expert.
        episode: which flight of a dataset, from 0 (null: all, up to most; of two: the first).
        most: how many flights of a dataset are opened.
        policy: folder of a run whose predicted actions are drawn along the flights.
        tier: disturbance tier where a run flies now.
        seed: of the flight of a run.
        save: where the file goes (null: below runs/inspections).
        web: serve the viewer to this machine's browsers.
        port: of that page; its data take the next one; 0 for any that are free.
        screenshot: also draw a picture, .png or .webp; no screen is needed, but Chromium is.
        at: moment of the picture, as a share of the flight, 0 to 1 (null: its end).
    """

    path: str
    beside: str | None = None
    episode: int | None = None
    most: int = 50
    policy: str | None = None
    tier: Tier = "calm"
    seed: int = 10_000
    save: str | None = None
    web: bool = False
    port: int = 9090
    screenshot: str | None = None
    at: float | None = None

    def __post_init__(self) -> None:
        at_least(self, most=1, seed=0, port=0)
        if self.save and Path(self.save).suffix != ".rrd":
            raise InvalidValueError(f"save={self.save} is not a file of rerun: its name must end in .rrd.")
        if self.screenshot and Path(self.screenshot).suffix not in (".png", ".webp"):
            raise InvalidValueError(
                f"screenshot={self.screenshot} is not an image: its name must end in .png or .webp."
            )
        if self.at is not None and not 0.0 <= self.at <= 1.0:
            raise InvalidValueError(f"at={self.at:g} is not a fraction of a flight, from 0 to 1.")
        if self.at is not None and not self.screenshot:
            raise InvalidValueError("at=... is the moment of a screenshot: set screenshot=FILE too.")


@dataclass(frozen=True)
class Inspected:
    """The file for rerun, the picture if one was wanted, and what there is to say of the flights."""

    file: Path
    picture: Path | None
    notes: tuple[str, ...]


def inspect(settings: Inspect) -> Inspected:
    """Write the file, and the picture that is wanted."""
    from aerial_il.presentation.rerun.program import program

    program()
    target = claim_file(settings.save or f"{INSPECTIONS}/{_name(settings)}.rrd", key="save")
    if settings.screenshot:
        claim_file(settings.screenshot, key="screenshot")
    notes, picture = _write(settings, target), None
    if settings.screenshot:
        from aerial_il.presentation.rerun import screenshot

        picture = Path(screenshot.take(target, Path(settings.screenshot), at=settings.at))
    return Inspected(target, picture, tuple(notes))


def _write(settings: Inspect, target: Path) -> list[str]:
    from aerial_il.presentation.rerun.file import FlightFile

    with FlightFile(target) as file:
        if settings.beside is not None:
            return list(_compare(settings, settings.beside, file))
        notes = list[str]()
        for flight in _flights(settings, settings.path, settings.episode):
            notes += _lines_of(flight)
            file.add({"": flight}, name=flight.episode.uid)
        return notes


def _lines_of(flight: Flight) -> list[str]:
    episode = flight.episode
    end = "success" if episode.success else "no success"
    return [f"{episode.uid}: {len(episode)} steps, {end}", *(f"  {note}" for note in flight.notes)]


def _compare(settings: Inspect, beside: str, file: FlightFile) -> Iterator[str]:
    """Add two flights, the second one aligned with the first; yield what is to be said of them."""
    from aerial_il.presentation.rerun.comparison import align

    first = next(iter(_flights(settings, settings.path, settings.episode or 0)))
    second = next(iter(_flights(settings, beside, settings.episode or 0, like=first.episode)))
    for flight in (first, second):
        yield from _lines_of(flight)
    aligned = align(first, second)
    yield f"Aligned by {aligned.by}: {', '.join(aligned.milestones) or 'they have no others in common'}."
    roots = _roots(settings.path, beside)
    flights, clocks = (first, second), (aligned.first, aligned.second)
    file.add(
        dict(zip(roots, flights, strict=True)),
        name=f"{first.episode.uid} beside {second.episode.uid}",
        clocks=dict(zip(roots, clocks, strict=True)),
    )


def _flights(settings: Inspect, source: str, index: int | None, like: Episode | None = None) -> Iterator[Flight]:
    """Yield what is to be shown of one of the two things, posed and judged.

    Args:
        like: the flight beside it, whose cell an expert flies, and whose seed.
    """
    from aerial_il.presentation.rerun.flight import Flight
    from aerial_il.workflows.parts.scenes import SubtaskJudge

    with SubtaskJudge() as judge:
        predict = _predictor(settings.policy)
        if source == "expert" or (Path(source) / METRICS).exists():
            episodes: Iterator[Episode] = _flown_now(source, settings.tier, settings.seed, like)
        else:
            episodes = _chosen(source, index, settings.most)
        for episode in episodes:
            yield Flight.of(episode, judge(episode), predict(episode))


def _roots(first: str, second: str) -> tuple[str, str]:
    """Return short names of two things, as the first parts of entity paths."""
    from aerial_il.presentation.rerun.geometry import plain

    names = [plain(Path(source).stem) or "flight" for source in (first, second)]
    return (f"{names[0]}/", f"{names[1]}/") if names[0] != names[1] else (f"{names[0]}/", f"{names[1]}_2/")


def _name(settings: Inspect) -> str:
    parts = [Path(source).stem or "here" for source in (settings.path, settings.beside) if source]
    return "-".join(parts + ([] if settings.episode is None else [f"{settings.episode}"]))


def _flown_now(source: str, tier: str, seed: int, like: Episode | None) -> Iterator[Episode]:
    """Yield the flight of a run's policy, or of the expert, in the cell and from the start of ``like`` if there is one.

    Args:
        source: folder of a run, or ``expert``. tier, seed: of the flight, where none is beside it.
    """
    from aerial_il.workflows.parts import pilots

    if source == pilots.EXPERT and like is None:
        raise InvalidValueError("expert is shown beside another flight: aerial-il inspect runs/NAME expert")
    spec = like.spec if like is not None else None
    if spec is not None and spec.is_outside:
        raise InvalidValueError(
            f"{source} cannot be flown beside {spec.robot}/{spec.task}: that environment is not part of the suite."
        )
    cell = (spec.robot, spec.task, spec.action.level) if spec else (None, None, None)
    pilot = pilots.pilot(source, robot=cell[0], task=cell[1], action=cell[2])
    law = spec.controller if spec else pilots.DEFAULT_CONTROLLER
    env = pilot.environment(spec.tier if spec else tier, num_envs=1, threads=1, controller=law)
    with closing(env), TemporaryDirectory() as folder:
        first = like.seed if like is not None else seed
        yield pilots.record(env, pilot.policy, first, Path(folder) / "flight.mcap", name=source)


def _chosen(source: str, index: int | None, most: int) -> Iterator[Episode]:
    """Yield the episode of an index, negative from the end, or the first ``most`` of all, pictures included."""
    from aerial_il.core.errors import DemoError
    from aerial_il.data.dataset import open_dataset

    dataset = open_dataset(Path(source), cameras=True, failures=True)
    count = len(dataset)
    if index is None:
        yield from dataset.only(dataset.uids[:most])
    elif -count <= index < count:
        yield dataset[index]
    else:
        problem, hint = f"has no episode {index}.", f"List them with: aerial-il info {dataset.path}"
        raise DemoError(dataset.path, problem, expected=f"0 to {count - 1}", got=index, hint=hint)


def _predictor(source: str | None) -> Callable[[Episode], Prediction | None]:
    """Return what predicts actions along flights by the policy of a run; None of them without a run."""
    if source is None:
        return lambda episode: None
    from aerial_il.evaluation.predictions import predict
    from aerial_il.policies import load_policy

    return partial(predict, load_policy(source))
