"""The stages of every learning study: demonstrations, trainings, evaluations, each done once and kept in its record.

A training differs from its sisters in its draw: of demonstrations, and with them of weights and minibatches. Killed at
any moment, the same call continues; several processes may share a record as long as they work on different draws.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import aerial_il
from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.interactive.algorithm import InteractiveAlgorithm
from aerial_il.algorithms.interactive.round_flights import ROUNDS
from aerial_il.algorithms.run.cadence import CADENCE
from aerial_il.algorithms.run.folder import METRICS, read_metrics
from aerial_il.collection.collect import collect
from aerial_il.core.contracts import BatchEnv, Policy
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.data.dataset import Dataset
from aerial_il.data.folder import LOG
from aerial_il.evaluation.result import FILE_NAME, EvaluationResult, load_result
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.workflows.generate import Generate, generate
from experiments.common.demonstrations import Generated, Source, collections, demonstrate, first, gather
from experiments.common.plain import plain
from experiments.common.record import Record


class Training(Protocol):
    """One policy to be trained; :class:`Cloned` is one."""

    @property
    def source(self) -> Source:
        """Where its demonstrations come from."""
        ...

    @property
    def label(self) -> str:
        """Its name for people, a path."""
        ...

    def decided_by(self) -> dict[str, Any]:
        """Return all that decides its result."""
        ...

    def train(self, stages: Stages, run: Path) -> Policy:
        """Train it, or go on, in the folder ``run``; return the final policy."""
        ...


@dataclass(frozen=True, eq=False)
class Shown:
    """What every policy that begins with some demonstrations is described by.

    Attributes:
        method: name for people. source: of the demonstrations; its draw is the training's seed. demos: how many.
        policy: what is trained.
    """

    method: str
    source: Source
    demos: int
    policy: PolicySettings

    @property
    def label(self) -> str:
        return (
            f"{self.method}/{self.source.robot}-{self.source.task}-{self.source.tier}/{self.demos}/{self.source.draw}"
        )


@dataclass(frozen=True, eq=False)
class Cloned(Shown):
    """A policy cloned from its demonstrations.

    Attributes:
        algorithm: how, beside those of :class:`Shown`.
    """

    algorithm: BC

    def decided_by(self) -> dict[str, Any]:
        return all_that_decides(self)

    def train(self, stages: Stages, run: Path) -> Policy:
        shown = stages.demonstrations(self.source, self.demos, cameras=self.policy.images)
        return self.algorithm.train(shown, self.policy, run=run, seed=self.source.draw, progress=stages.progress)


@dataclass(frozen=True, eq=False)
class Asked(Shown):
    """A policy trained by asking the expert while it flies.

    Attributes:
        algorithm: how, beside those of :class:`Shown`.
    """

    algorithm: InteractiveAlgorithm

    @property
    def episodes(self) -> int:
        """Demonstrations and labelled flights in all."""
        return self.demos + self.algorithm.rounds * self.algorithm.episodes

    @property
    def steps(self) -> int:
        """Optimisation steps of all rounds."""
        return steps_of(self.algorithm)

    def decided_by(self) -> dict[str, Any]:
        return all_that_decides(self)

    def train(self, stages: Stages, run: Path) -> Policy:
        expert = aerial_il.expert(self.source.robot, self.source.task)
        return train_in_rounds(self, self.algorithm, stages, run, worlds=self.algorithm.episodes, expert=expert)


def train_in_rounds(
    training: Shown, algorithm: InteractiveAlgorithm, stages: Stages, run: Path, *, worlds: int, expert: Policy | None
) -> Policy:
    """Train a policy that goes on from its demonstrations by flying, or go on, in the folder ``run``.

    Args:
        training: what begins. algorithm: how it goes on. stages: of the study. worlds: flown at once.
        expert: whom it asks; None where nobody is.
    """
    source = training.source
    env = stages.environment(source, source.tier, worlds)
    try:
        return algorithm.train(
            stages.demonstrations(source, training.demos, cameras=training.policy.images),
            training.policy,
            run=run,
            env=env,
            expert=expert,
            collect=collect,
            seed=source.draw,
            progress=stages.progress,
        )
    finally:
        env.close()


def all_that_decides(training: Any) -> dict[str, Any]:
    """Return all that decides the result of a training from demonstrations.

    Args:
        training: with ``source``, ``demos``, ``policy`` and ``algorithm``.
    """
    return {
        "source": training.source.decided_by(),
        "demos": training.demos,
        "policy": described(training.policy),
        "algorithm": without_cadence(training.algorithm),
    }


@dataclass(frozen=True, kw_only=True)
class Stages:
    """Does what a record does not hold yet.

    Attributes:
        record: of the study. num_envs: worlds flown at once. threads: of the simulation; 0 for all cores.
        progress: show progress bars. most: demonstrations that a draw is begun with, so that it is flown in one go.
        places: all folders that were used, by kind.
    """

    record: Record
    num_envs: int = 50
    threads: int = 0
    progress: bool = True
    most: int = 0
    places: dict[str, dict[Path, None]] = field(default_factory=dict, compare=False, repr=False)

    def demonstrations(self, source: Source, count: int, *, cameras: tuple[str, ...] = ()) -> Dataset:
        """Return the first ``count`` successful flights of a source, flying those that are missing."""
        path = self._dataset(source)
        wanted = max(count, self.most)
        fly = partial(self._generate if isinstance(source, Generated) else demonstrate, source, path)
        how = {"num_envs": min(self.num_envs, wanted), "threads": self.threads, "progress": self.progress}
        gather(path, wanted, source.seed, partial(fly, **how))
        return first(path, count, cameras=cameras)

    def _generate(self, source: Generated, path: Path, flights: int, **how: Any) -> None:
        """Generate the first ``flights`` seeds of a source that the dataset ``path`` does not hold yet."""
        shown = self.demonstrations(source.shown, source.few)
        where = {"dataset": str(shown.path), "sources": source.few, "out": str(path)}
        what = {"seed": source.seed, "cameras": source.cameras, "image_size": source.image_size}
        generate(Generate(**where, **what, episodes=flights, **how))

    def run_of(self, training: Training) -> Path:
        """Return the folder of a training."""
        return self.place("training", training.label, training.decided_by())

    def policy(self, training: Training) -> Policy:
        """Return the final policy of a training."""
        return training.train(self, self.run_of(training))

    def judged(self, training: Training, tier: str, seeds: range, *, images: bool = True) -> EvaluationResult:
        """Return how the final policy of a training, which may look at ``images``, flies in a tier, on ``seeds``."""
        source = training.source
        seen = source if images else replace(source, cameras=())
        where = {
            "tier": tier,
            "seeds": [seeds.start, seeds.stop],
        }
        decided_by = {"training": training.decided_by(), **where}
        place = self.place("evaluations", f"{training.label}/{tier}", decided_by)
        self._dataset(source)  # the time of both is the study's, too, where they have been there before
        self.run_of(training)
        return judged_once(
            place,
            lambda: self.policy(training),
            lambda: self.environment(seen, tier, min(self.num_envs, len(seeds))),
            seeds,
            name=training.label,
            progress=self.progress,
        )

    def environment(self, source: Source, tier: str, num_envs: int) -> BatchEnvironment:
        """Return worlds of a training's cell, with its cameras."""
        return aerial_il.load_batch(
            source.robot,
            source.task,
            num_envs=num_envs,
            tier=tier,
            cameras=source.cameras,
            image_size=source.image_size,
            num_threads=self.threads,
        )

    def minutes(self, trainings: Iterable[Training]) -> float:
        """Return the mean wall time of some trainings, min."""
        found = [trained_s(self.run_of(training)) for training in trainings]
        return round(sum(found) / len(found) / 60, 2)

    def seconds(self) -> float:
        """Return how long all stages used so far took, whenever they were done."""
        collecting = sum(run["seconds"] for run in collections(self._used("datasets", LOG)))
        flying = sum(load_result(place).provenance["wall_time_s"] for place in self._used("evaluations", FILE_NAME))
        return collecting + flying + sum(map(trained_s, self._used("training", METRICS)))

    def _dataset(self, source: Source) -> Path:
        return self.place("datasets", source.label, source.decided_by())

    def place(self, kind: str, label: str, decided_by: dict[str, Any]) -> Path:
        place = self.record.place(kind, label, decided_by)
        self.places.setdefault(kind, {})[place] = None
        return place

    def _used(self, kind: str, name: str) -> list[Path]:
        """Return the places of a kind that hold a file of that name."""
        return [place for place in self.places.get(kind, {}) if (place / name).exists()]


def judged_once(
    place: Path,
    policy: Callable[[], Policy],
    open_env: Callable[[], BatchEnv],
    seeds: range,
    *,
    name: str,
    progress: bool,
) -> EvaluationResult:
    """Return the result that the folder ``place`` holds, or fly ``policy()`` on ``seeds`` and keep it there."""
    if (place / FILE_NAME).exists():
        return load_result(place)
    judged, env = policy(), open_env()
    try:
        result = evaluate(env, judged, seeds, policy_name=name, progress=progress)
    finally:
        env.close()
    result.save(place)
    return result


def described(policy: PolicySettings) -> dict[str, Any]:
    """Return a policy's settings as JSON values, with its name."""
    return {"name": policy.name, **policy.to_dict()}


def without_cadence(settings: Any) -> dict[str, Any]:
    """Return an algorithm's settings as JSON values, without those that no weight depends on, at any depth."""

    def kept(tree: Any) -> Any:
        return {k: kept(v) for k, v in tree.items() if k not in CADENCE} if isinstance(tree, dict) else tree

    return kept(plain(settings))


def steps_of(algorithm: BC | InteractiveAlgorithm) -> int:
    """Return the optimisation steps of all rounds: the first and the last in full, those between shorter."""
    if isinstance(algorithm, BC):
        return algorithm.steps
    return 2 * algorithm.training.steps + (algorithm.rounds - 1) * algorithm.between_steps


def check_fewer(fewer: Mapping[str, int], known: Iterable[str], kind: str = "arm") -> None:
    """Refuse a smaller number of trainings for what is not trained at all, and numbers below one.

    Args:
        fewer: name -> in how many of the draws it is trained. known: the valid names. kind: what they stand for.

    Raises:
        UnknownNameError: a name is not among ``known``.
        InvalidValueError: a number is below 1.
    """
    known = tuple(known)
    for name, trainings in fewer.items():
        if name not in known:
            raise UnknownNameError(kind, name, known)
        if trainings < 1:
            raise InvalidValueError(f"fewer.{name} is {trainings}; it starts at 1. To leave it out, name the others.")


def own_time_s(run: Path) -> float:
    """Return the wall time that a run tells of itself; rows of evaluations on the way tell none. 0 for older runs."""
    return max((row.get("elapsed_s", 0.0) for row in read_metrics(run)), default=0.0)


def spent_s(runs: Iterable[Path], evaluations: Iterable[EvaluationResult]) -> float:
    """Return how long training and judging took, whenever it was done."""
    return sum(map(own_time_s, runs)) + sum(result.provenance["wall_time_s"] for result in evaluations)


def trained_s(run: Path) -> float:
    """Return the wall time of a training, and of what it began with below its folder: flying and learning.

    Rounds of a run that does not tell its own time, as older ones, count with their optimisation alone.
    """
    seconds = {file: own_time_s(file.parent) for file in run.rglob(METRICS)}
    tells = seconds.get(run / METRICS, 0.0) > 0.0
    return sum(s for file, s in seconds.items() if not (tells and ROUNDS in file.relative_to(run).parts))
