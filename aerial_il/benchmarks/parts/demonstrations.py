"""Demonstrations of a benchmark: collected once into its folder, taken in the order of their seeds."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import aerial_il
from aerial_il.algorithms.parts.run_folder import PROVENANCE
from aerial_il.collection.collect import collect
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.episode import Episode
from aerial_il.data.folder import LOG, DatasetFolder
from aerial_il.evaluation.result import EvaluationResult


@dataclass(frozen=True)
class Source:
    """Where demonstrations come from.

    Attributes:
        robot, task, tier: what is flown. noise: of the expert. seed: the first one flown.
        num_envs: worlds flown at once. threads: of the simulation; 0 for all cores.
    """

    robot: str
    task: str
    tier: str
    noise: float
    seed: int
    num_envs: int
    threads: int


def gather(source: Source, path: Path, wanted: int, *, progress: bool) -> None:
    """Fly the expert until ``path`` holds ``wanted`` successes; a failure costs one more seed.

    Raises:
        InvalidValueError: more than half of the flights fail.
    """
    dataset, flown = DatasetFolder(path), wanted
    while len(dataset.files()) < wanted:
        if flown > 2 * wanted:
            raise InvalidValueError(f"{path}: the expert fails too often to give {wanted} demonstrations.")
        env = aerial_il.load_batch(
            source.robot,
            source.task,
            num_envs=min(source.num_envs, wanted),
            tier=source.tier,
            num_threads=source.threads,
        )
        try:
            expert = aerial_il.expert(source.robot, source.task, noise=source.noise)
            seeds = range(source.seed, source.seed + flown)
            collect(env, expert, seeds, path, settings={"noise": source.noise}, progress=progress)
        finally:
            env.close()
        flown += wanted - len(dataset.files())


def first(path: Path, count: int) -> Iterator[Episode]:
    """Return the first ``count`` successful demonstrations in ``path``."""
    return islice((episode for episode in aerial_il.open_dataset(str(path)) if episode.success), count)


def collections(paths: Iterable[Path]) -> list[dict[str, Any]]:
    """Return what was logged of each collection into ``paths``."""
    return [json.loads(line) for path in dict.fromkeys(paths) for line in (path / LOG).read_text().splitlines()]


def origins(datasets: Iterable[Path], runs: Iterable[Path], results: Sequence[EvaluationResult]) -> list[str]:
    """Return a note that names the commits of the stages where there is more than one."""
    stages = [run["provenance"] for run in collections(datasets)]
    stages += [json.loads((run / PROVENANCE).read_text()) for run in runs]
    stages += [result.provenance for result in results]
    commits = sorted({stage["git"]["sha"][:10] for stage in stages if stage["git"]})
    return [f"The stages were done at several commits: {', '.join(commits)}."] if len(commits) > 1 else []
