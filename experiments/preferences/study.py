"""Flights by a good and a poor pilot: what preferences between pieces of them teach, beside cloning.

Half of the flights are the expert's, half those of a clone of a few of them that was trained too briefly; failures are
kept. A script judges pairs of segments by success and the time to it. What learns from its answers, and from answers of
which a tenth are wrong, is compared with clones of all flights, of the successes, and of the better half by reward, and
with filtered cloning, which practises where the others learn from recordings alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, ClassVar

import aerial_il
from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.cpl import CPL
from aerial_il.algorithms.filtered_bc import FilteredBC
from aerial_il.collection.collect import collect
from aerial_il.core.contracts import Policy
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.data.episode import Episode
from aerial_il.data.folder import DEMOS, FAILURES, DatasetFolder
from aerial_il.data.preferences.pairs import draw_pairs
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

POOR_SEED, SEEDS_PER_DRAW = 5_000_000, 10_000
CPL_ARM, FLIPPED, ALL, SUCCESSES, BETTER_HALF, FILTERED = (
    "cpl", "cpl_flipped", "all", "successes", "better_half", "filtered",
)  # fmt: skip
ARMS = (CPL_ARM, FLIPPED, ALL, SUCCESSES, BETTER_HALF, FILTERED)
GAIN, FLIPPED_SHARE = 10.0, 0.1
TIER = "calm"


@dataclass(frozen=True, eq=False)
class Mixed(Shown):
    """A policy that learns from ``demos`` flights, half of them good.

    Attributes:
        algorithm: how. poor: the pilot of the poor half.
    """

    algorithm: Any
    poor: Cloned

    def decided_by(self) -> dict[str, Any]:
        return {**all_that_decides(self), "arm": self.method, "poor": self.poor.decided_by()}

    def train(self, stages: Stages, run: Path) -> Policy:
        flights, source = mixed(stages, self.poor, self.demos), self.source
        options = {"run": run, "seed": source.draw, "progress": stages.progress}
        if not isinstance(self.algorithm, FilteredBC):
            return self.algorithm.train(flights, self.policy, **options)
        env = stages.environment(source, source.tier, stages.num_envs)
        try:
            return self.algorithm.train(flights, self.policy, env=env, collect=collect, **options)
        finally:
            env.close()


@dataclass(frozen=True, kw_only=True)
class Preferences:
    """Settings.

    Attributes:
        policy: what is trained. cloning: of flights. learning: from preferences. filtering: by practice.
        poor: how the poor pilot is cloned. poor_demos: of how many flights of the expert.
        robot: that flies. tasks: what it does. demos: flights learned from, half of them good.
        arms: who learns. draws: of flights and weights. episodes: that judge a policy. first_episode: the first.
        num_envs: worlds flown at once. threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "preferences"
    question: ClassVar[str] = "Do preferences between pieces of good and poor flights teach more than cloning them?"

    policy: PolicySettings = field(default_factory=MLP)
    cloning: BC = BC(steps=5_000, validation=0.0)
    learning: CPL = CPL(cloning=BC(steps=5_000, validation=0.0))
    filtering: FilteredBC = FilteredBC(rounds=2, episodes=100, training=BC(steps=5_000, validation=0.0))
    poor: BC = BC(steps=1_500, validation=0.0)
    poor_demos: int = 10
    robot: str = "fa_hexa_arm4"
    tasks: tuple[str, ...] = ("pick_place", "insert_peg")
    demos: int = 120
    arms: tuple[str, ...] = ARMS
    draws: tuple[int, ...] = (0, 1)
    episodes: int = 100
    first_episode: int = EVALUATION_SEED
    num_envs: int = 25
    threads: int = 0

    def __post_init__(self) -> None:
        for task in self.tasks:
            registered.get(task)
        for name in self.arms:
            if name not in ARMS:
                raise UnknownNameError("arm", name, ARMS)
        if not self.draws or min(self.demos // 2, self.poor_demos, self.episodes, self.num_envs) < 1:
            raise InvalidValueError("draws names one at least; demos starts at 2, the other numbers at 1.")
        check_seeds(self.first_episode, self.episodes)

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Fly, train and evaluate what ``folder`` does not hold yet; see :class:`Study`."""
        stages = Stages(record=Record(folder), num_envs=self.num_envs, threads=self.threads, progress=progress)
        seeds = range(self.first_episode, self.first_episode + self.episodes)
        judged = {each: stages.judged(each, TIER, seeds) for each in bar([*self._trainings()], self.name, progress)}
        rows = [*_rows(judged)]
        return Report(
            study=self,
            targets=(*_targets(rows),),
            tables={"Policies": rows, "Flights and answers": [self._answers(stages, task) for task in self.tasks]},
            notes=(*NOTES, *_beside(rows), *stages.record.notes()),
            details={"failed_seeds": {each.label: failed_seeds(result) for each, result in judged.items()}},
            wall_time_s=stages.seconds(),
        )

    def _trainings(self) -> Iterator[Mixed]:
        for draw, task, arm in product(self.draws, self.tasks, self.arms):
            poor = self._poor(task, draw)
            yield Mixed(arm, poor.source, self.demos, self.policy, self._algorithm(arm), poor)

    def _poor(self, task: str, draw: int) -> Cloned:
        source = Source(robot=self.robot, task=task, tier=TIER, noise=NOISE, draw=draw)
        return Cloned("poor", source, self.poor_demos, self.policy, self.poor)

    def _algorithm(self, arm: str) -> BC | CPL | FilteredBC:
        everything = replace(self.cloning.selection, failures=1.0)
        return {
            CPL_ARM: self.learning,
            FLIPPED: replace(self.learning, judge=replace(self.learning.judge, flipped=FLIPPED_SHARE)),
            ALL: replace(self.cloning, selection=everything),
            SUCCESSES: self.cloning,
            BETTER_HALF: replace(self.cloning, selection=replace(everything, quality="reward", keep=0.5)),
            FILTERED: self.filtering,
        }[arm]

    def _answers(self, stages: Stages, task: str) -> Row:
        """Return how many flights succeed, and how often the script prefers the expert's segment, in all draws."""
        good = poor = preferred = against = equal = 0
        for draw in self.draws:
            flights = mixed(stages, self._poor(task, draw), self.demos)
            experts = {episode.uid for episode in flights[: self.demos // 2]}
            learning, lengths = self.learning, {episode.uid: len(episode) for episode in flights}
            pairs = draw_pairs(lengths, learning.pairs, length=learning.length, seed=learning.judge.seed)
            for said in learning.judge.judge(flights, pairs):
                if (left := said.left.uid in experts) != (said.right.uid in experts):
                    preferred += said.preferred == ("left" if left else "right")
                    against += said.preferred == ("right" if left else "left")
                    equal += said.preferred == "equal"
            good += sum(episode.success for episode in flights if episode.uid in experts)
            poor += sum(episode.success for episode in flights if episode.uid not in experts)
        return {
            "task": task,
            "flights": self.demos * len(self.draws),
            "good_succeed": good,
            "poor_succeed": poor,
            "expert_preferred": preferred,
            "poor_preferred": against,
            "equal": equal,
        }


NOTES = (
    "Flights: half the expert's with noise 0.3, all successes; half a poor pilot's, a clone of few of them, whatever "
    "came of them. Answers: of the script, to pairs of one segment of either half.",
    "Policies: cpl, from preferences, a tenth of them wrong in cpl_flipped; all, successes, better_half (by mean "
    "reward): clones of these flights; filtered: of the successes, and of its own in two rounds of practice.",
)


def mixed(stages: Stages, poor: Cloned, demos: int) -> list[Episode]:
    """Return flights of the expert and, as many, of a poor pilot."""
    count = demos // 2
    good = list(stages.demonstrations(poor.source, max(count, poor.demos)))[:count]
    first = POOR_SEED + SEEDS_PER_DRAW * poor.source.draw
    decided_by = {"pilot": poor.decided_by(), "first": first, "flown": count}
    place = stages.record.place("datasets", poor.label, decided_by)
    stages.places.setdefault("datasets", {})[place] = None
    if sum(len(DatasetFolder(place).files(kind)) for kind in (DEMOS, FAILURES)) < count:
        _fly_poorly(stages, poor, range(first, first + count), place)
    return [*good, *aerial_il.open_dataset(str(place), failures=True)]


def _fly_poorly(stages: Stages, poor: Cloned, seeds: range, place: Path) -> None:
    """Record flights of the poor pilot that are missing in the folder ``place``."""
    env = stages.environment(poor.source, poor.source.tier, min(stages.num_envs, len(seeds)))
    try:
        collect(env, stages.policy(poor), seeds, place, policy_name="poor", progress=stages.progress)
    finally:
        env.close()


def _rows(judged: Mapping[Mixed, EvaluationResult]) -> Iterator[Row]:
    return pooled_rows(
        ({"task": training.source.task, "arm": training.method}, result) for training, result in judged.items()
    )


def _targets(rows: list[Row]) -> Iterator[Target]:
    cells = {(row["task"], row["arm"]): row for row in rows}
    for (task, arm), row in cells.items():
        if arm in (CPL_ARM, FLIPPED) and (other := cells.get((task, ALL))) is not None:
            gain = round(row["percent"] - other["percent"], 1)
            p = fisher(row["success"], row["episodes"], other["success"], other["episodes"])
            spread = f"{other['percent']} % by cloning all, {row['percent']} % by preferences; p = {p:.2g}"
            yield Target(
                f"gained over cloning the same flights: {task}, {arm}", "at least", GAIN, gain, "points", spread
            )


def _beside(rows: list[Row]) -> Iterator[str]:
    """Say how preferences do beside the best of the other ways."""
    cells = {(row["task"], row["arm"]): row["percent"] for row in rows}
    for task in dict.fromkeys(row["task"] for row in rows):
        others = {arm: cells[task, arm] for arm in (SUCCESSES, BETTER_HALF, FILTERED) if (task, arm) in cells}
        if CPL_ARM in {arm for cell, arm in cells if cell == task} and others:
            said = ", ".join(f"{arm} {percent:g} %" for arm, percent in others.items())
            mine, ahead = cells[task, CPL_ARM], cells[task, CPL_ARM] - max(others.values())
            word = "more" if ahead > 0.0 else "less"
            verdict = f"Preferences teach {abs(ahead):.3g} points {word} than the best of these."
            yield f"{task}: cpl {mine:g} %; with the same flights, and success known of each, {said}. {verdict}"
