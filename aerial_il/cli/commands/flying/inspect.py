"""Look at flights in rerun: the real scene in motion, its forces and pictures, and every signal on one timeline.

A dataset opens with all of its flights, a run with its policy flying now. Two things are shown side by side, on a
timeline on which their phases fall together.

Example: aerial-il inspect datasets/pick episode=3
Example: aerial-il inspect datasets/pick runs/pick episode=3 save=compared.rrd
Example: aerial-il inspect datasets/pick episode=0 policy=runs/pick screenshot=chunks.png at=0.5
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from aerial_il.cli.configuration.keys import MISSING, MaybeLocated, TierName, at_least, group, key
from aerial_il.cli.configuration.keys import path as located
from aerial_il.core.errors import InvalidValueError

if TYPE_CHECKING:
    from aerial_il.data.episode import Episode
    from aerial_il.presentation.rerun.flight import Flight

INSPECTIONS = "runs/inspections"
METRICS = "metrics.jsonl"  # what a run has and a dataset has not


@dataclass
class Config:
    path: str = key(MISSING, "a recording, a dataset (ours, LeRobot, HDF5), or the folder of a run", position=0)
    beside: str | None = key(None, "what to compare it with: the same kinds, or: expert", position=1)
    episode: int | None = key(None, "which flight of a dataset, from 0 (null: all, up to most; of two: the first)")
    most: int = key(50, "how many flights of a dataset are opened")
    policy: MaybeLocated = located(MaybeLocated, "folder of a run whose predicted actions are drawn along the flights")
    tier: TierName = group("disturbance tier where a run flies now", "calm", composed=True)
    seed: int = key(10000, "of the flight of a run")
    save: str | None = key(None, f"where the file goes (null: below {INSPECTIONS})")
    web: bool = key(False, "serve the viewer to this machine's browsers")
    port: int = key(9090, "of that page; its data take the next one; 0 for any that are free")
    screenshot: str | None = key(None, "also draw a picture, .png or .webp; no screen is needed, but Chromium is")
    at: float | None = key(None, "moment of the picture, as a share of the flight, 0 to 1 (null: its end)")

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


def run(config: Config) -> None:
    """Write the file, and show it as far as this machine can."""
    from aerial_il.presentation.rerun.program import program

    program()
    target = Path(config.save or f"{INSPECTIONS}/{_name(config)}.rrd")
    _write(config, target)
    print(f"{target}: {target.stat().st_size / 1e6:.1f} MB")
    if config.screenshot:
        from aerial_il.presentation.rerun import screenshot

        print(f"Picture: {screenshot.take(target, Path(config.screenshot), at=config.at)}")
    _show(config, target)


def _write(config: Config, target: Path) -> None:
    from aerial_il.presentation.rerun.file import FlightFile

    with FlightFile(target) as file:
        if config.beside is None:
            for flight in _flights(config, config.path, config.episode):
                _tell(flight)
                file.add({"": flight}, name=flight.episode.uid)
        else:
            _compare(config, file)


def _compare(config: Config, file: object) -> None:
    """Add two flights, the second one aligned with the first."""
    from aerial_il.presentation.rerun.comparison import align
    from aerial_il.presentation.rerun.file import FlightFile

    assert isinstance(file, FlightFile)
    assert config.beside is not None
    first = next(iter(_flights(config, config.path, config.episode or 0)))
    second = next(iter(_flights(config, config.beside, config.episode or 0, like=first.episode)))
    for flight in (first, second):
        _tell(flight)
    aligned = align(first, second)
    print(f"Aligned by {aligned.by}: {', '.join(aligned.milestones) or 'they have no others in common'}.")
    roots = _roots(config.path, config.beside)
    flights, clocks = (first, second), (aligned.first, aligned.second)
    file.add(
        dict(zip(roots, flights, strict=True)),
        name=f"{first.episode.uid} beside {second.episode.uid}",
        clocks=dict(zip(roots, clocks, strict=True)),
    )


def _flights(config: Config, source: str, index: int | None, like: Episode | None = None) -> Iterator[Flight]:
    """Yield what is to be shown of one of the two things, posed and judged.

    Args:
        like: the flight beside it, whose cell an expert flies, and whose seed.
    """
    from aerial_il.presentation.rerun.flight import Flight
    from aerial_il.presentation.rerun.sources import chosen, open_source
    from aerial_il.workflows.parts.inspected import flown_now, predictor
    from aerial_il.workflows.parts.scenes import SubtaskJudge

    with SubtaskJudge() as judge:
        predict = predictor(config.policy.path)
        if source == "expert" or (Path(source) / METRICS).exists():
            episodes: Iterator[Episode] = flown_now(source, config.tier.name, config.seed, like)
        else:
            episodes = chosen(open_source(source), index, config.most)
        for episode in episodes:
            yield Flight.of(episode, judge(episode), predict(episode))


def _tell(flight: Flight) -> None:
    episode = flight.episode
    end = "success" if episode.success else "no success"
    print(f"{episode.uid}: {len(episode)} steps, {end}")
    for note in flight.notes:
        print(f"  {note}")


def _roots(first: str, second: str) -> tuple[str, str]:
    """Return short names of two things, as the first parts of entity paths."""
    from aerial_il.presentation.rerun.geometry import plain

    names = [plain(Path(source).stem) or "flight" for source in (first, second)]
    return (f"{names[0]}/", f"{names[1]}/") if names[0] != names[1] else (f"{names[0]}/", f"{names[1]}_2/")


def _name(config: Config) -> str:
    parts = [Path(source).stem or "here" for source in (config.path, config.beside) if source]
    return "-".join(parts + ([] if config.episode is None else [f"{config.episode}"]))


def _show(config: Config, target: Path) -> None:
    """Open a window or a page, or say how."""
    from aerial_il.presentation.films.window import has_screen
    from aerial_il.presentation.rerun import program

    if config.web:
        data_port = config.port + 1 if config.port else 0
        with program.page(target, port=config.port, data_port=data_port) as (server, address):
            print(f"Open {address}\nCtrl-C ends it.", flush=True)
            server.wait()
    elif has_screen() and not (config.save or config.screenshot):
        program.open_window(target)
        print("rerun shows it.")
    elif not (config.save or config.screenshot):
        print(f"No screen here. On a machine with one: rerun {target}; or serve a page with web=true")
