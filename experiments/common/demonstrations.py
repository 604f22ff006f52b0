"""Demonstrations of a benchmark: in draws, for trainings that are to differ in them, each in the order of its seeds.

They are flown by the expert, or generated out of a few that it flew.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import aerial_il
from aerial_il.collection.collect import collect
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.dataset import Dataset
from aerial_il.data.folder import DEMOS, FAILURES, LOG, DatasetFolder

SEEDS_PER_DRAW, DRAWS = 100_000, 10  # evaluations lie inside the first (20000 ...), flights of DAgger beyond the last
GENERATION_SEED = 3_000_000  # far from demonstrations, practice and evaluations
NOISE = 0.3  # of the expert, as aerial-il collect flies it by default
MOST_PER_DRAW = 2_500  # demonstrations: twice as many flights stay below the seeds of tuning (5000 ...)


@dataclass(frozen=True, kw_only=True)
class Source:
    """Where demonstrations come from.

    Attributes:
        robot, task, tier: what is flown. noise: of the expert. draw: which of several independent draws.
        cameras, image_size: what is recorded beside the state, e.g. ``wrist`` or ``wrist@96x96@25Hz@40ms``.
    """

    robot: str
    task: str
    tier: str = "calm"
    noise: float = 0.0
    draw: int = 0
    cameras: tuple[str, ...] = ()
    image_size: tuple[int, int] = (64, 64)

    def __post_init__(self) -> None:
        if not 0 <= self.draw < DRAWS:
            raise InvalidValueError(f"draw is {self.draw}; there are draws 0 to {DRAWS - 1}.")

    @property
    def seed(self) -> int:
        """The first one flown."""
        return SEEDS_PER_DRAW * self.draw

    @property
    def label(self) -> str:
        return f"{self.robot}-{self.task}-{self.tier}/{self.draw}"

    def decided_by(self) -> dict[str, Any]:
        """Return all that decides the flights."""
        return {**asdict(self), "seed": self.seed}


@dataclass(frozen=True, kw_only=True)
class Generated(Source):
    """Flights that are generated out of the first demonstrations of a draw, with images where those have them.

    Attributes:
        few: how many demonstrations they are generated out of.
    """

    few: int

    @property
    def shown(self) -> Source:
        """Where those come from."""
        return Source(**{each.name: getattr(self, each.name) for each in fields(Source)})

    @property
    def seed(self) -> int:
        return GENERATION_SEED + self.shown.seed

    @property
    def label(self) -> str:
        return f"generated/{self.few}/{self.shown.label}"


def demonstrate(source: Source, path: Path, flights: int, *, num_envs: int, threads: int, progress: bool) -> None:
    """Let the expert fly the first ``flights`` seeds of a source that the dataset ``path`` does not hold yet."""
    env = aerial_il.load_batch(
        source.robot,
        source.task,
        num_envs=num_envs,
        tier=source.tier,
        cameras=source.cameras,
        image_size=source.image_size,
        num_threads=threads,
    )
    with closing(env):
        expert = aerial_il.expert(source.robot, source.task, noise=source.noise)
        seeds = range(source.seed, source.seed + flights)
        collect(env, expert, seeds, path, settings={"noise": source.noise}, progress=progress)


def gather(path: Path, wanted: int, seed: int, fly: Callable[[int], None]) -> None:
    """Fly until ``path`` holds the first ``wanted`` successes; a failure costs one more seed.

    Args:
        path: the dataset. wanted: how many. seed: the first one. fly: flies so many seeds, but for those that ``path``
            holds.

    Raises:
        InvalidValueError: more than half of the flights fail, or more are wanted than a draw has seeds for.
    """
    if wanted > MOST_PER_DRAW:
        raise InvalidValueError(f"{wanted} demonstrations are wanted; one draw has at most {MOST_PER_DRAW}.")
    dataset, flown = DatasetFolder(path), wanted
    while (missing := wanted - _won_in_a_row(dataset, seed)) > 0:
        if flown > 2 * wanted:
            raise InvalidValueError(f"{path}: too many flights fail to give {wanted} demonstrations.")
        fly(flown)
        missing = wanted - _won_in_a_row(dataset, seed)
        flown += missing


def first(path: Path, count: int, *, cameras: tuple[str, ...] = ()) -> Dataset:
    """Return the first ``count`` successful demonstrations in ``path``, with images of ``cameras``."""
    dataset = aerial_il.open_dataset(str(path), cameras=cameras)
    return dataset.only(sorted(dataset.uids)[:count])


def collections(paths: Iterable[Path]) -> Iterator[dict[str, Any]]:
    """Yield what was logged of each collection into ``paths``."""
    for path in dict.fromkeys(paths):
        yield from map(json.loads, (path / LOG).read_text().splitlines())


def _won_in_a_row(dataset: DatasetFolder, seed: int) -> int:
    """Return the successes from ``seed`` on to the first seed not flown: what was killed in between leaves gaps."""
    found = {kind: {_seed_of(file) for file in dataset.files(kind)} for kind in (DEMOS, FAILURES)}
    won = 0
    while seed in found[DEMOS] or seed in found[FAILURES]:
        won += seed in found[DEMOS]
        seed += 1
    return won


def _seed_of(file: Path) -> int:
    return int(file.stem.rsplit("-", 2)[1])
