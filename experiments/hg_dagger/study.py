"""HG-DAgger with a model of a person: from a policy that often fails to one that rarely does, at what share of flying.

The model of a driver records a few demonstrations at the sticks; a policy is cloned from them, flies, and is rescued by
the driver where it goes wrong, round by round, on what the driver flew. Beside it stands its control: cloning as many
of the driver's demonstrations as there were episodes in all, with as many optimisation steps. Every stage is kept by
all that decides it: killed at any moment, the same call continues.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.dagger import DAgger
from aerial_il.algorithms.interactive.gates.human import HumanGate
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.collection.collect import collect
from aerial_il.core.contracts import Policy
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.dataset import Dataset, open_dataset
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.policies import load_policy
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.network import PolicySettings
from aerial_il.teleop.driver.operator import DriverOperator
from aerial_il.teleop.piloting.arbiter import HAND_OVER_TICKS
from experiments.common.driver import Driven, suited
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, bar
from experiments.common.seeds import EVALUATION_SEED, check_seeds
from experiments.common.stages import described, judged_once, steps_of, trained_s, without_cadence
from experiments.common.success import failed_seeds, pooled_row, pooled_target

START, ASKED, CONTROL = "bc, first demonstrations", "hg_dagger", "bc, as many episodes and steps"
JUDGED_PERCENT, SHARE_PERCENT = 90.0, 10.0
NOTES = (
    "The driver is a model: reaction time 0.25 s, errors of perception, tremor, pauses, several habits; it sees the "
    "page's numbers and marks and moves sticks. No person has flown.",
    "The final policy of each training; trainings differ in their draw: in the driver's habits and errors, the seeds "
    "of all flights, weights and minibatches.",
    "Share: fraction of the frames in the rounds' flights that the driver flew; the initial demonstrations are not "
    "included.",
    "Steps: distance between the commanded tool positions of two consecutive control steps, in the rounds' flights. "
    "Changes of hands: at the step of a takeover or a hand-back; all others: without the steps over which a change "
    "is blended.",
)


@dataclass(frozen=True, kw_only=True)
class HgDagger:
    """Settings.

    Attributes:
        policy: what is trained. training: supervised learning in each round. between_steps: in those between.
        robot, task, tier: what is flown. demos: of the driver, to begin with. rounds, per_round: how many, of flights.
        draws: one training each. episodes: unseen seeds per evaluation.
        first_episode: the first of them. num_envs: worlds flown at once there.
        by_hand: learn from the driver's flights as ``aerial-il train`` does by itself from a person's; False for as
            they were recorded.
    """

    name: ClassVar[str] = "hg_dagger"
    question: ClassVar[str] = "Do occasional takeovers by a person turn a policy that often fails into a good one?"

    policy: PolicySettings = field(default_factory=lambda: MLP(dropout=0.2))
    training: BC = field(default_factory=lambda: BC(steps=6_000))
    between_steps: int = 3_000
    robot: str = "fa_hexa_arm4"
    task: str = "pick_place"
    tier: str = "calm"
    demos: int = 10
    rounds: int = 20
    per_round: int = 10
    draws: tuple[int, ...] = (0, 1, 2)
    episodes: int = 100
    first_episode: int = EVALUATION_SEED
    num_envs: int = 50
    by_hand: bool = True

    def __post_init__(self) -> None:
        if min(self.demos, self.rounds, self.per_round, self.episodes, self.num_envs) < 1 or not self.draws:
            raise InvalidValueError(
                "demos, rounds, per_round, episodes and num_envs start at 1; draws name at least one."
            )
        check_seeds(self.first_episode, self.episodes)

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Fly, train and judge what ``folder`` does not hold yet; see :class:`Study`."""
        draws = [Draw(self, Record(folder), draw, progress) for draw in self.draws]
        found = {each: each.results() for each in bar(draws, self.name, progress)}
        arms = {name: [results[name] for results in found.values()] for name in (START, ASKED, CONTROL)}
        pooled = [{"arm": name, **self._cost(name), **pooled_row(results)} for name, results in arms.items()]
        rounds = [{"draw": each.draw, **row} for each in draws for row in each.rounds()]
        steps = [{"draw": each.draw, **each.steps()} for each in draws]
        return Report(
            study=self,
            targets=tuple(targets_of(pooled, rounds, steps)),
            tables={"Success": pooled, "Round by round": rounds, "Steps of the command, mm": steps},
            notes=NOTES,
            details={
                "failed_seeds": {
                    f"{name}: {each.draw}": failed_seeds(result)
                    for each, results in found.items()
                    for name, result in results.items()
                }
            },
            wall_time_s=sum(each.seconds() for each in draws),
        )

    @property
    def learner(self) -> tuple[BC, PolicySettings]:
        """How the learner is trained, and what it is."""
        return suited(self.training, self.policy) if self.by_hand else (self.training, self.policy)

    @property
    def algorithm(self) -> DAgger:
        """HG-DAgger."""
        return DAgger(
            gate=HumanGate(),
            rounds=self.rounds,
            episodes=self.per_round,
            training=self.learner[0],
            between_steps=self.between_steps,
            evaluate_every=0,
            keep_checkpoints=self.rounds + 1,
        )

    def _cost(self, arm: str) -> Row:
        asked = arm != START
        steps = steps_of(self.algorithm) if asked else self.training.steps
        return {"episodes_in_all": self.demos + asked * self.rounds * self.per_round, "steps": steps}


@dataclass(frozen=True, eq=False)
class Draw:
    """One draw: its demonstrations, its rounds, its control, and how each of them flies.

    Attributes:
        study: the settings. record: of the study. draw: which. progress: show progress bars.
    """

    study: HgDagger
    record: Record
    draw: int
    progress: bool

    @cached_property
    def driven(self) -> Driven:
        return Driven(self.study.robot, self.study.task, self.study.tier, self.draw)

    def results(self) -> dict[str, EvaluationResult]:
        """Return how the policies fly, in the order in which they are trained."""
        asked = self._judged(ASKED, self._asked)
        start = self._judged(START, lambda: load_policy(self._run(ASKED) / "rounds" / "000" / "training"))
        return {START: start, ASKED: asked, CONTROL: self._judged(CONTROL, self._cloned)}

    def rounds(self) -> Iterator[Row]:
        """Yield what each round's flights cost and brought."""
        frames = by_driver = 0
        for row in read_metrics(self._run(ASKED))[1:]:
            frames, by_driver = frames + row["flight_steps"], by_driver + row["expert_steps"]
            yield {
                "round": int(row["step"]),
                "flights": int(row["flights"]),
                "solved": int(row["flights_solved"]),
                "solved_alone": int(row["solved_alone"]),
                "interventions": int(row["interventions"]),
                "frames": int(row["flight_steps"]),
                "by_driver": int(row["expert_steps"]),
                "share": round(100 * row["expert_steps"] / row["flight_steps"], 1),
                "share_so_far": round(100 * by_driver / frames, 1),
            }

    def steps(self) -> Row:
        """Return percentiles of the command's steps, at changes of hands and elsewhere, mm."""
        flights = open_dataset(self._run(ASKED) / "dataset", failures=True)
        pairs = [command_steps(e.actions, e.is_intervention) for e in flights if e.is_intervention.any()]
        changes, others = (1000.0 * np.concatenate(part) for part in zip(*pairs, strict=True))
        at = {"usual_p50": 50, "usual_p99": 99, "usual_p99_9": 99.9}
        found = {name: round(float(np.percentile(others, q)), 2) for name, q in at.items()}
        return {
            "changes": len(changes),
            **found,
            "usual_max": round(float(others.max()), 2),
            "changes_p50": round(float(np.percentile(changes, 50)), 2),
            "changes_max": round(float(changes.max()), 2),
        }

    def seconds(self) -> float:
        """Return how long flying and learning in rounds took."""
        return trained_s(self._run(ASKED))

    def _decided_by(self, arm: str) -> dict[str, Any]:
        study = self.study
        trained = asdict(study.learner[0]) if arm == CONTROL else without_cadence(study.algorithm)
        return {
            "arm": ASKED if arm == START else arm,
            "driven": self.driven.decided_by(),
            "demos": study.demos,
            "flights": study.rounds * study.per_round,
            "policy": described(study.learner[1]),
            "algorithm": json.loads(json.dumps(trained)),
        }

    def _run(self, arm: str) -> Path:
        return self.record.place("training", f"{arm}/{self.driven.label}", self._decided_by(arm))

    def _judged(self, arm: str, policy: Any) -> EvaluationResult:
        study = self.study
        seeds = range(study.first_episode, study.first_episode + study.episodes)
        decided_by = {"training": self._decided_by(arm), "arm": arm, "seeds": [seeds.start, seeds.stop]}
        place = self.record.place("evaluations", f"{arm}/{self.driven.label}", decided_by)
        worlds = min(study.num_envs, len(seeds))
        return judged_once(
            place, policy, lambda: self.driven.environment(worlds), seeds, name=arm, progress=self.progress
        )

    def _demonstrations(self, count: int) -> Dataset:
        return self.driven.demonstrations(self.record, count)

    def _asked(self) -> Policy:
        env = self.driven.environment(1)
        try:
            return self.study.algorithm.train(
                self._demonstrations(self.study.demos),
                self.study.learner[1],
                run=self._run(ASKED),
                env=env,
                expert=DriverOperator(seed=self.draw),
                collect=collect,
                seed=self.draw,
                progress=self.progress,
            )
        finally:
            env.close()

    def _cloned(self) -> Policy:
        study = self.study
        training, policy = study.learner
        longer = replace(training, steps=steps_of(study.algorithm))
        demos = self._demonstrations(study.demos + study.rounds * study.per_round)
        return longer.train(demos, policy, run=self._run(CONTROL), seed=self.draw, progress=self.progress)


def command_steps(actions: np.ndarray, held: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the commanded positions' steps (m) at changes of hands, and at all ticks that none of them touches.

    Args:
        actions: (T, Da), a position first. held: (T,) bool, the person flew.
    """
    steps = np.linalg.norm(np.diff(actions[:, :3], axis=0), axis=1)
    changes = np.flatnonzero(np.diff(held.astype(int)))
    touched = (changes[:, None] + np.arange(HAND_OVER_TICKS)).ravel()
    usual = np.setdiff1d(np.arange(len(steps)), touched)
    return steps[changes], steps[usual]


def targets_of(pooled: Sequence[Row], rounds: Sequence[Row], steps: Sequence[Row]) -> Iterator[Target]:
    arms: Mapping[str, Row] = {row["arm"]: row for row in pooled}
    start, judged = arms[START], arms[ASKED]
    yield Target("the policy to begin with", "at most", 50.0, start["percent"], "%", "40 to 50 % is meant")
    yield pooled_target("HG-DAgger", JUDGED_PERCENT, judged)
    share = 100 * sum(row["by_driver"] for row in rounds) / sum(row["frames"] for row in rounds)
    yield Target("frames flown by the driver", "at most", SHARE_PERCENT, round(share, 2), "%")
    worst = max(steps, key=lambda row: row["changes_max"] / row["usual_p99_9"])
    what = "largest step where hands change / 99.9th percentile elsewhere"
    ratio = round(worst["changes_max"] / worst["usual_p99_9"], 3)
    yield Target(what, "at most", 1.0, ratio, "", f"draw {worst['draw']}, the worst one")
