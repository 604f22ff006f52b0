"""Demonstrations chosen by their influence on what a policy's own flights came to, beside other choices.

The flights of a good and a poor pilot, as in the study of preferences, are cloned; the clone flies, and each
demonstration is scored by its influence on the success of that. The half with the highest score is cloned again,
beside a random half and the successes, of which somebody has to say that they are. Of a set with planted bad
demonstrations, as in the study of quality, it is told how many of the lowest scores are theirs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

import aerial_il
from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.supervised.influence import influence
from aerial_il.collection.collect import collect
from aerial_il.core.bounded import read_json
from aerial_il.core.contracts import Policy
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.files import write_json
from aerial_il.core.seeding import named_rng
from aerial_il.data.dataset import Dataset
from aerial_il.data.episode import Episode
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.statistics import fisher
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.suite import tasks as registered
from experiments.common.demonstrations import NOISE, Source
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, bar
from experiments.common.seeds import EVALUATION_SEED, check_seeds
from experiments.common.stages import Cloned, Shown, Stages, all_that_decides
from experiments.common.success import failed_seeds, pooled_rows
from experiments.preferences.study import mixed
from experiments.quality.planted import KINDS
from experiments.quality.study import planted

FLOWN_SEED, SEEDS_PER_DRAW = 6_000_000, 10_000
ALL, INFLUENCE, RANDOM, SUCCESSES = "all", "influence", "random", "successes"
ARMS = (ALL, INFLUENCE, RANDOM, SUCCESSES)
GAIN, TIER = 10.0, "calm"


@dataclass(frozen=True, eq=False)
class Mix(Shown):
    """A clone of some of ``demos`` flights, half of them good, the others of a poor pilot.

    Attributes:
        algorithm: how it is cloned. poor: the pilot of the poor half. flights: of the clone of all, by which
            demonstrations are scored.
    """

    algorithm: BC
    poor: Cloned
    flights: int

    def decided_by(self) -> dict[str, Any]:
        scored = {"flights": self.flights} if self.method == INFLUENCE else {}
        return {**all_that_decides(self), "arm": self.method, "poor": self.poor.decided_by(), **scored}

    def train(self, stages: Stages, run: Path) -> Policy:
        shown = self.chosen(stages, mixed(stages, self.poor, self.demos))
        options = {"run": run, "seed": self.source.draw, "progress": stages.progress}
        return self.algorithm.train(shown, self.policy, failures=True, **options)

    def chosen(self, stages: Stages, demos: list[Episode]) -> list[Episode]:
        """Return the demonstrations that it is cloned from, in their order."""
        if self.method == SUCCESSES:
            return [episode for episode in demos if episode.success]
        if self.method == INFLUENCE:
            scores = scored(stages, replace(self, method=ALL), demos, self.flights)
            return half(demos, [scores[episode.uid] for episode in demos])
        return half(demos, named_rng(self.source.draw, RANDOM).random(len(demos))) if self.method == RANDOM else demos


def half(demos: Sequence[Episode], scores: Sequence[float] | np.ndarray) -> list[Episode]:
    """Return the half of the demonstrations with the highest scores, in their order."""
    return [demos[i] for i in sorted(np.argsort(scores, kind="stable")[len(demos) - len(demos) // 2 :])]


def scored(stages: Stages, clone: Any, demos: Sequence[Episode], flights: int) -> dict[str, float]:
    """Return the influence of each demonstration on the success of flights of their clone."""
    file = stages.place("scores", clone.label, {"clone": clone.decided_by(), "flights": flights}) / "influence.json"
    if not file.exists():
        policy: Any = stages.policy(clone)
        write_json(file, influence(policy, demos, flown(stages, clone, flights)))
    return dict(read_json(file))


def flown(stages: Stages, clone: Any, count: int) -> Dataset:
    """Return flights of a clone, its failures among them, flying those that are missing."""
    first = FLOWN_SEED + SEEDS_PER_DRAW * clone.source.draw
    place = stages.place("datasets", f"flown/{clone.label}", {"clone": clone.decided_by(), "first": first})
    env = stages.environment(clone.source, TIER, min(stages.num_envs, count))
    try:
        seeds = range(first, first + count)
        collect(env, stages.policy(clone), seeds, place, policy_name=clone.method, progress=stages.progress)
    finally:
        env.close()
    return aerial_il.open_dataset(str(place), failures=True, states=False)


@dataclass(frozen=True, eq=False)
class Faulty(Shown):
    """A clone of ``demos`` demonstrations, a ``share`` of them bad, in known ways."""

    algorithm: BC
    share: float

    def decided_by(self) -> dict[str, Any]:
        return {**all_that_decides(self), "share": self.share, "kinds": list(KINDS)}

    def train(self, stages: Stages, run: Path) -> Policy:
        demos, _ = planted(stages, self.source, self.demos, self.share, KINDS)
        return self.algorithm.train(demos, self.policy, run=run, seed=self.source.draw, progress=stages.progress)


@dataclass(frozen=True, kw_only=True)
class Influence:
    """Settings.

    Attributes:
        policy: what is cloned. cloning: how. poor: how the poor pilot is cloned. poor_demos: of how many flights of the
            expert. robot: that flies. tasks: what it does. demos: flights learned from, half of them good.
        planted: tasks on which bad demonstrations are looked for. share: of bad ones among ``demos``.
        arms: what is cloned. draws: of flights and weights. flights: of a clone, by which demonstrations are scored.
        episodes: that judge a clone. first_episode: the first. num_envs: worlds flown at once.
        threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "influence"
    question: ClassVar[str] = "Does a clone gain from demonstrations that are chosen by their influence on its flights?"

    policy: PolicySettings = field(default_factory=MLP)
    cloning: BC = BC(steps=5_000, validation=0.0)
    poor: BC = BC(steps=1_500, validation=0.0)
    poor_demos: int = 10
    robot: str = "fa_hexa_arm4"
    tasks: tuple[str, ...] = ("pick_place", "insert_peg")
    demos: int = 120
    planted: tuple[str, ...] = ("pick_place",)
    share: float = 0.1
    arms: tuple[str, ...] = ARMS
    draws: tuple[int, ...] = (0, 1)
    flights: int = 100
    episodes: int = 100
    first_episode: int = EVALUATION_SEED
    num_envs: int = 25
    threads: int = 0

    def __post_init__(self) -> None:
        for task in (*self.tasks, *self.planted):
            registered.get(task)
        for name in self.arms:
            if name not in ARMS:
                raise UnknownNameError("arm", name, ARMS)
        numbers = (self.demos // 2, self.poor_demos, self.flights, self.episodes, self.num_envs)
        if not self.draws or min(numbers) < 1:
            raise InvalidValueError("draws names one at least; demos starts at 2, the other numbers at 1.")
        check_seeds(self.first_episode, self.episodes)

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Fly, score, train and evaluate what ``folder`` does not hold yet; see :class:`Study`."""
        stages = Stages(record=Record(folder), num_envs=self.num_envs, threads=self.threads, progress=progress)
        seeds = range(self.first_episode, self.first_episode + self.episodes)
        judged = {each: stages.judged(each, TIER, seeds) for each in bar([*self._trainings()], self.name, progress)}
        rows = [*_rows(judged)]
        tables = {
            "Clones": rows,
            "Highest half": [self._chosen(stages, task) for task in self.tasks if INFLUENCE in self.arms],
            "Planted": [self._found(stages, task) for task in self.planted],
        }
        return Report(
            study=self,
            targets=(*_targets(rows),),
            tables={name: table for name, table in tables.items() if table},
            notes=(*NOTES, *([OF_PLANTED] if self.planted else []), *stages.record.notes()),
            details={"failed_seeds": {each.label: failed_seeds(result) for each, result in judged.items()}},
            wall_time_s=stages.seconds(),
        )

    def _trainings(self) -> Iterator[Mix]:
        for draw, task, arm in product(self.draws, self.tasks, self.arms):
            yield self._mix(arm, task, draw)

    def _mix(self, arm: str, task: str, draw: int) -> Mix:
        source = Source(robot=self.robot, task=task, tier=TIER, noise=NOISE, draw=draw)
        poor = Cloned("poor", source, self.poor_demos, self.policy, self.poor)
        return Mix(arm, source, self.demos, self.policy, self.cloning, poor, self.flights)

    def _chosen(self, stages: Stages, task: str) -> Row:
        """Return who flew the half with the highest scores, and what the shortest half is, in all draws of a task."""
        kept = experts = solved = short = 0
        for draw in self.draws:
            training = self._mix(INFLUENCE, task, draw)
            demos = mixed(stages, training.poor, self.demos)
            best, good = training.chosen(stages, demos), {episode.uid for episode in demos[: self.demos // 2]}
            kept += len(best)
            experts += sum(episode.uid in good for episode in best)
            solved += sum(episode.success for episode in best)
            short += sum(episode.success for episode in half(demos, [-len(episode) for episode in demos]))
        return {
            "task": task,
            "draws": len(self.draws),
            "kept": kept,
            "of_the_expert": experts,
            "successes": solved,
            "successes_in_shortest_half": short,
        }

    def _found(self, stages: Stages, task: str) -> Row:
        """Return how many planted demonstrations are among as many with the lowest scores, in the first draw."""
        source = Source(robot=self.robot, task=task, tier=TIER, noise=NOISE, draw=self.draws[0])
        clone = Faulty("planted", source, self.demos, self.policy, self.cloning, self.share)
        demos, kinds = planted(stages, source, self.demos, self.share, KINDS)
        scores = scored(stages, clone, demos, self.flights)
        lowest = sorted(scores, key=scores.__getitem__)[: len(kinds)]
        negative = [uid for uid, score in scores.items() if score <= 0.0]
        return {
            "task": task,
            "demos": len(demos),
            "planted": len(kinds),
            "found_among_as_many_lowest": sum(uid in kinds for uid in lowest),
            "not_above_0": len(negative),
            "found_not_above_0": sum(uid in kinds for uid in negative),
        }


NOTES = (
    "Flights: half the expert's with noise 0.3, all successes; half a poor pilot's, a clone of few of them, whatever "
    "came of them. The poor pilot's failures last until the time is up, so the shortest half, which needs no score, is "
    "told, too.",
    "Clones: all, of all flights; influence, of the half with the highest influence on flights of that clone, on seeds "
    "of their own; random, of a random half; successes, of those that succeed, where that was known.",
)
OF_PLANTED = "Planted: some of the demonstrations are bad, in six ways; found by influence alone."


def _rows(judged: Mapping[Mix, EvaluationResult]) -> Iterator[Row]:
    return pooled_rows(
        ({"task": training.source.task, "arm": training.method}, result) for training, result in judged.items()
    )


def _targets(rows: list[Row]) -> Iterator[Target]:
    cells = {(row["task"], row["arm"]): row for row in rows}
    for task in dict.fromkeys(row["task"] for row in rows):
        mine = cells.get((task, INFLUENCE))
        for arm in (ALL, RANDOM):
            if mine is not None and (other := cells.get((task, arm))) is not None:
                gain = round(mine["percent"] - other["percent"], 1)
                p = fisher(mine["success"], mine["episodes"], other["success"], other["episodes"])
                spread = f"{other['percent']} % by {arm}, {mine['percent']} % by influence; p = {p:.2g}"
                yield Target(f"gained over a clone of {arm}: {task}", "at least", GAIN, gain, "points", spread)
