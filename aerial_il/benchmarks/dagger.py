"""What an expert's answers are worth: cloning its flights, or asking it while the learner flies, at equal cost.

Every arm begins with the same few demonstrations. The interactive ones add the same number of flights in rounds;
cloning gets as many demonstrations as those have episodes in all, and, in a second arm, as many as have at least as
many labelled steps as classic DAgger used. The final policies are flown on the same unseen seeds. Every stage leaves
its result in the folder of the benchmark: killed at any moment, the same call continues.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, ClassVar

import aerial_il
from aerial_il.algorithms.bc import BehaviourCloning
from aerial_il.algorithms.dagger import DAgger
from aerial_il.algorithms.dart import Dart
from aerial_il.algorithms.parts.gates import CoinGate, ThriftyGate
from aerial_il.algorithms.parts.rounds import plain
from aerial_il.algorithms.parts.run_folder import read_metrics
from aerial_il.benchmarks.parts.claim import claim
from aerial_il.benchmarks.parts.progress import bar
from aerial_il.benchmarks.parts.report import Report, Row, Target
from aerial_il.benchmarks.parts.success import failed_seeds, success_row, success_target
from aerial_il.collection.collect import collect
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.policy import Policy
from aerial_il.data.episode import Episode
from aerial_il.evaluation.result import FILE_NAME, EvaluationResult, load_result
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.evaluation.statistics import wilson
from aerial_il.policies import load_policy
from aerial_il.policies.mlp import MlpConfig
from aerial_il.policies.parts.network import PolicyConfig
from aerial_il.suite.batch import BatchEnvironment

START, EPISODES, LABELS = "bc, first demonstrations", "bc, as many episodes", "bc, as many labels"
INTERACTIVE = ("dagger", "dart", "thrifty")
ARMS = (START, EPISODES, "dagger", LABELS, "dart", "thrifty")
EVALUATION_SEED = 10_000
DAGGER_PERCENT = 95.0
NOTES = (
    "The final policy of each run; intervals are Wilson's over all evaluation episodes of all seeds together.",
    "Labelled steps: every step of a demonstration, and every step at which the expert was asked; ThriftyDAgger's "
    "flights of the learner alone are not labelled and do not count as episodes.",
    "The experts are scripted, see the simulator's state and can take over from anywhere.",
)


@dataclass(frozen=True)
class Arm:
    """One training: a cell, a way to learn, and the seed of the training."""

    robot: str
    task: str
    name: str
    seed: int

    @property
    def cell(self) -> str:
        return f"{self.robot}-{self.task}"

    @property
    def place(self) -> str:
        return f"{self.cell}/{self.name.replace(', ', '_').replace(' ', '_')}/{self.seed}"


@dataclass(frozen=True, kw_only=True)
class Interactive:
    """Settings.

    Attributes:
        policy: what is trained. training: supervised learning. robot: name. tasks: names. arms: which of them.
        tier: in which everything is flown. demos: demonstrations to begin with. noise: of the expert in them.
        rounds, episodes: of the interactive arms. between_steps: optimisation steps between rounds.
        beta: of classic DAgger. ensemble, alone, alarms: of ThriftyDAgger. scale: of DART's noise.
        seeds: trainings of each arm. flown: unseen seeds per evaluation. num_envs: worlds flown at once in evaluations
            and demonstrations. threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "dagger"
    question: ClassVar[str] = "Does asking the expert while the learner flies beat cloning as much of its work?"

    policy: PolicyConfig = field(default_factory=MlpConfig)
    training: BehaviourCloning = field(default_factory=BehaviourCloning)
    robot: str = "fa_hexa_arm4"
    tasks: tuple[str, ...] = ("insert_peg", "pick_place")
    arms: tuple[str, ...] = ARMS
    tier: str = "calm"
    demos: int = 20
    noise: float = 0.0
    rounds: int = 6
    episodes: int = 10
    between_steps: int = 2_000
    beta: str = "exponential"
    ensemble: int = 3
    alone: int = 10
    alarms: float = 0.02
    scale: float = 1.0
    seeds: int = 3
    flown: int = 100
    num_envs: int = 50
    threads: int = 0

    def __post_init__(self) -> None:
        for name in self.arms:
            if name not in ARMS:
                raise UnknownNameError("arm", name, ARMS)
        if min(self.demos, self.rounds, self.episodes, self.seeds, self.flown, self.num_envs) < 1:
            raise InvalidValueError("demos, rounds, episodes, seeds, flown and num_envs start at 1.")

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Fly, train and judge what ``folder`` does not hold yet; see :class:`Benchmark`."""
        claim(folder, self._plain(), free=("tasks", "arms", "seeds", "num_envs", "threads"))
        wanted = [Arm(self.robot, task, name, k) for k, task, name in product(range(self.seeds), self.tasks, self.arms)]
        results = {arm: self._result(arm, folder, progress) for arm in bar(wanted, self.name, progress)}
        singles = [self._row(arm, result, folder) for arm, result in results.items()]
        pooled = _pooled(singles)
        return Report(
            name=self.name,
            question=self.question,
            settings=self._plain(),
            targets=tuple(_targets(pooled)),
            tables={"Cloning and asking": pooled, "Single trainings": singles},
            notes=NOTES,
            details={"failed_seeds": {arm.place: failed_seeds(result) for arm, result in results.items()}},
            wall_time_s=sum(result.provenance["wall_time_s"] for result in results.values()),
        )

    def _result(self, arm: Arm, folder: Path, progress: bool) -> EvaluationResult:
        judged = folder / "evaluations" / arm.place
        if (judged / FILE_NAME).exists():
            return load_result(judged)
        policy = self._trained(arm, folder, progress)
        env = self._environment(arm.task, min(self.num_envs, self.flown))
        try:
            seeds = range(EVALUATION_SEED, EVALUATION_SEED + self.flown)
            result = evaluate(env, policy, seeds, policy_name=arm.name, progress=progress)
        finally:
            env.close()
        result.save(judged)
        return result

    def _trained(self, arm: Arm, folder: Path, progress: bool) -> Policy:
        run, algorithm = folder / "training" / arm.place, self._algorithm(arm.name)
        if algorithm is None:
            shown = self._demonstrations(arm, self._wanted(arm, folder, progress), folder, progress)
            return self.training.train(shown, self.policy, run=run, seed=arm.seed, progress=progress)
        env, shown = self._environment(arm.task, self.episodes), self._demonstrations(arm, self.demos, folder, progress)
        expert = aerial_il.expert(arm.robot, arm.task)
        try:
            return algorithm.train(
                shown, self.policy, run=run, env=env, expert=expert, collect=collect, seed=arm.seed, progress=progress
            )
        finally:
            env.close()

    def _algorithm(self, name: str) -> DAgger | Dart | None:
        common: dict[str, Any] = {
            "rounds": self.rounds,
            "episodes": self.episodes,
            "training": self.training,
            "between_steps": self.between_steps,
        }
        if name == "dart":
            return Dart(scale=self.scale, **common)
        gates: dict[str, Any] = {
            "dagger": CoinGate(beta=self.beta),  # pyright: ignore[reportArgumentType]
            "thrifty": ThriftyGate(ensemble=self.ensemble, alone=self.alone, alarms=self.alarms),
        }
        return DAgger(gate=gates[name], **common) if name in gates else None

    def _wanted(self, arm: Arm, folder: Path, progress: bool) -> int:
        """Return how many demonstrations an arm of cloning gets."""
        if arm.name == START:
            return self.demos
        if arm.name == EPISODES:
            return self.demos + self.rounds * self.episodes
        asking = replace(arm, name="dagger")
        self._result(asking, folder, progress)
        labelled = read_metrics(folder / "training" / asking.place)[-1]["total/labelled_steps"]
        count, steps = self.demos, 0
        while steps < labelled:  # demonstrations are all about as long
            steps = sum(map(len, self._demonstrations(arm, count, folder, progress)))
            count += max(1, int((labelled - steps) / (steps / count))) if steps < labelled else 0
        return count

    def _demonstrations(self, arm: Arm, count: int, folder: Path, progress: bool) -> list[Episode]:
        """Return the first ``count`` successful flights of the expert, flying those that are missing."""
        dataset, flown = folder / "datasets" / arm.cell, count
        while len(found := _successes(dataset)) < count:
            if flown > 3 * count:
                raise InvalidValueError(f"{dataset}: the expert fails too often to give {count} demonstrations.")
            env = self._environment(arm.task, min(self.num_envs, count))
            try:
                expert = aerial_il.expert(arm.robot, arm.task, noise=self.noise)
                collect(env, expert, range(flown), dataset, settings={"noise": self.noise}, progress=progress)
            finally:
                env.close()
            flown += count
        return [aerial_il.open_dataset(str(dataset))[uid] for uid in found[:count]]

    def _environment(self, task: str, num_envs: int) -> BatchEnvironment:
        return aerial_il.load_batch(self.robot, task, num_envs=num_envs, tier=self.tier, num_threads=self.threads)

    def _row(self, arm: Arm, result: EvaluationResult, folder: Path) -> Row:
        rows = read_metrics(folder / "training" / arm.place)
        if arm.name in INTERACTIVE:
            cost = {key: int(rows[-1][f"total/{key}"]) for key in ("episodes", "labelled_steps", "queries")}
            cost["interventions"] = int(sum(row["interventions"] for row in rows))
        else:
            count = load_policy(folder / "training" / arm.place).origin["dataset"]["demonstrations"]
            steps = sum(map(len, self._demonstrations(arm, count, folder, progress=False)))
            cost = {"episodes": count, "labelled_steps": steps, "queries": 0, "interventions": 0}
        judged = {k: v for k, v in success_row(result).items() if k != "episodes"} | {"flown": len(result.episodes)}
        return {"task": arm.task, "arm": arm.name, "seed": arm.seed, **cost, **judged}

    def _plain(self) -> dict[str, Any]:
        """The settings as JSON gives them back."""
        return json.loads(json.dumps(plain(self) | {"policy": {"name": self.policy.name, **self.policy.to_dict()}}))


def _successes(dataset: Path) -> list[str]:
    """Return the uids of the successful flights by seed, which is how they are named."""
    return sorted(file.stem for file in (dataset / "demos").glob("*.mcap"))


def _pooled(singles: Sequence[Mapping[str, Any]]) -> list[Row]:
    """Sum the trainings of each arm up: success over all their flights, cost of the mean one."""
    rows = []
    for task, arm in dict.fromkeys((row["task"], row["arm"]) for row in singles):
        own = [row for row in singles if (row["task"], row["arm"]) == (task, arm)]
        count, flown = (sum(row[key] for row in own) for key in ("success", "flown"))
        low, high = wilson(count, flown)
        cost = {k: round(sum(row[k] for row in own) / len(own)) for k in ("episodes", "labelled_steps", "queries")}
        rate = {"success": count, "flown": flown, "percent": round(100 * count / flown, 1)}
        interval = {"ci95_low": round(100 * low, 1), "ci95_high": round(100 * high, 1)}
        rows.append({"task": task, "arm": arm, "seeds": len(own), **cost, **rate, **interval})
    return rows


def _targets(pooled: Sequence[Row]) -> list[Target]:
    """Return what classic DAgger must reach on each task."""
    return [
        success_target(
            f"{row['task']}: DAgger, {row['episodes']} episodes", DAGGER_PERCENT, row | {"episodes": row["flown"]}
        )
        for row in pooled
        if row["arm"] == "dagger"
    ]


BENCHMARK = Interactive
