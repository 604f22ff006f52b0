"""Reaching with a fixed arm by reinforcement learning alone: which algorithm arrives, and which of them shakes.

DDPG, TD3 and soft actor-critic bring the tool of ``z1`` to a pose and hold it, commanding joint velocities or poses of
the tool, rewarded for the pose alone with hindsight (sparse) or by the environment (dense). Beside each that commands
joint velocities with sparse reward stands the same training with penalties for jerky motion, and no other difference.
Every stage is kept by all that decides it: killed at any moment, the same call continues.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np

import aerial_il
from aerial_il.algorithms.ddpg import DDPG
from aerial_il.algorithms.online.smoothness import Smoothness
from aerial_il.algorithms.sac import SAC
from aerial_il.algorithms.td3 import TD3
from aerial_il.core.composition import build
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import write_json
from aerial_il.evaluation.result import FILE_NAME, EvaluationResult, load_result
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from experiments.common.figures import success_curves
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, bar
from experiments.common.seeds import EVALUATION_SEED, TUNING_SEEDS
from experiments.common.stages import described, own_time_s, spent_s, without_cadence
from experiments.common.success import failed_seeds, pooled_row, pooled_target, success_on_the_way
from experiments.z1_reach.holding import Holding, hold

ROBOT, TASK, TIER = "z1", "reach", "calm"
Reward = Literal["sparse", "dense"]
ALGORITHMS, REWARDS = ("sac", "td3", "ddpg"), ("sparse", "dense")
HOLDING, HELD_STEPS, WATCHED_STEPS, HELD_SEEDS = "holding.json", 200, 100, 100
LARGEST_JERK_SHARE = 0.5
NOTES = (
    "The final policy of each training is evaluated on the same held-out seeds, up to 20 s each; success is the pose"
    " within 2 cm and 10° for 1 s. The trainings of an arm differ in weights and in the episodes they fly. "
    "What no target asks for is trained less often.",
    "Sparse: 1 for each step in the pose, and hindsight with four later poses of the same episode; in training, not "
    "in evaluation, half the tolerance counts (hindsight.tolerance). Dense: the environment's own reward, without "
    "hindsight. Training episodes have a fixed length that success does not end.",
    "Smooth: CAPS and a penalty for the change of the action; all else is as in the plain arm.",
    "Jerk: root mean square of the commanded action's third derivative up to success, in the unit of the action level; "
    "compare it within one level. Fast: share of the action's changes that lies above 5 Hz, by power.",
    "Held: the first hundred of these seeds flown for 4 s through success; of the last 2 s how far the action moves "
    "from step to step (share of half its range), how often it turns about (at most 50 times a second), and the "
    "distance from the target within which the tool stays 95 % of the time.",
    "Flights: Wilson's 95 % interval over the flights of these very policies. Trainings: Student's 95 % interval with "
    "a training as the unit. Curves: tuning seeds, mean of the trainings, from the lowest to the highest.",
)


@dataclass(frozen=True, order=True)
class Arm:
    """What is compared: an algorithm, the level of its actions, its reward, and whether smoothness is asked for."""

    action: str
    reward: Reward
    algorithm: str
    smooth: bool

    @property
    def label(self) -> str:
        """Its name for people."""
        return f"{self.algorithm}{', smooth' * self.smooth}"

    @property
    def place(self) -> str:
        """Its name for folders."""
        return f"{self.action}-{self.reward}/{self.algorithm}{'-smooth' * self.smooth}"


LEARNING: Mapping[str, Any] = {
    "steps": 200_000, "warmup": 5_000, "gamma": 0.97, "lr": 0.001, "lr_floor": 0.05,
    "replay": {"updates_per_step": 0.25}, "critics": {"hidden": (128, 128), "layer_norm": True},
    "hindsight": {"goals": 4, "tolerance": 0.5},
    "cadence": {"evaluate_every": 20_000, "checkpoint_every": 50_000, "keep_checkpoints": 1},
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Z1Reach:
    """Settings.

    Attributes:
        policy: what is trained. sac, td3, ddpg: how; hindsight is theirs where the reward is sparse.
        smooth: what smooth arms are asked for. algorithms: which, the best one first.
        actions: levels of actions; smooth arms have the first alone. rewards: the same of rewards.
        seeds: trainings of what targets ask for, the first algorithm with the first action level and the first reward,
            plain and smooth; others: of all other arms.
        horizon: steps of a learning episode. num_envs: worlds that learn.
        episodes: unseen seeds that judge.
        first_episode: the first of them. curve_episodes: tuning seeds flown on the way.
        threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "z1_reach"
    question: ClassVar[str] = (
        "Which reinforcement learning algorithms make a fixed arm reach every pose, and why do some shake?"
    )

    policy: SquashedGaussian = SquashedGaussian(hidden=(128, 128))
    sac: SAC = build(SAC, LEARNING)
    td3: TD3 = build(TD3, LEARNING)
    ddpg: DDPG = build(DDPG, LEARNING)
    smooth: Smoothness = Smoothness(temporal=0.1, spatial=0.05, radius=0.05, rate_penalty=0.01, jerk_penalty=0.0)
    algorithms: tuple[str, ...] = ALGORITHMS
    actions: tuple[str, ...] = ("velocity", "ee_pose")
    rewards: tuple[Reward, ...] = ("sparse", "dense")
    seeds: int = 3
    others: int = 1
    horizon: int = 100
    num_envs: int = 8
    episodes: int = 1000
    first_episode: int = EVALUATION_SEED
    curve_episodes: int = 50
    threads: int = 1

    def __post_init__(self) -> None:
        for what, known in (("algorithms", ALGORITHMS), ("rewards", REWARDS)):
            if unknown := set(getattr(self, what)) - set(known):
                raise InvalidValueError(f"{what} names {sorted(unknown)}; valid: {', '.join(known)}.")
        if not (self.algorithms and self.actions and self.rewards) or min(self.seeds, self.others, self.episodes) < 1:
            raise InvalidValueError(
                "algorithms, actions and rewards name one at least; seeds, others and episodes start at 1."
            )

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Train and judge what ``folder`` does not hold yet; see :class:`Study`."""
        record, results = Record(folder), {}
        for arm, seed in bar(self.trainings(), self.name, progress):
            results[arm, seed] = self._judged(arm, seed, record, progress)
        return self._report(record, results)

    def trainings(self) -> list[tuple[Arm, int]]:
        """Return all trainings, those that the targets ask for first."""
        found = [(arm, seed) for arm in self.arms() for seed in self.seeds_of(arm)]
        return sorted(found, key=lambda training: (not self._is_asked(training[0]), training[1]))

    def seeds_of(self, arm: Arm) -> range:
        """Return the seeds of an arm's trainings."""
        return range(self.seeds if self._is_asked(arm) else self.others)

    def _is_asked(self, arm: Arm) -> bool:
        return (arm.action, arm.reward, arm.algorithm) == (self.actions[0], self.rewards[0], self.algorithms[0])

    def arms(self) -> list[Arm]:
        """Return what is compared."""
        plain = [
            Arm(action, reward, algorithm, False)
            for action, reward, algorithm in product(self.actions, self.rewards, self.algorithms)
        ]
        smooth = [Arm(self.actions[0], self.rewards[0], algorithm, True) for algorithm in self.algorithms]
        return [*smooth, *plain]

    def learner(self, arm: Arm) -> Any:
        """Return the algorithm of an arm."""
        settings = getattr(self, arm.algorithm)
        if arm.reward == "dense":
            settings = replace(settings, hindsight=SAC().hindsight)
        return replace(settings, smoothness=self.smooth if arm.smooth else SAC().smoothness)

    def environment(self, arm: Arm, num_envs: int, *, horizon: int | None = None) -> Any:
        """Return worlds of an arm, over a fixed ``horizon`` or to be judged in."""
        return aerial_il.load_batch(
            ROBOT,
            TASK,
            num_envs=num_envs,
            tier=TIER,
            action=arm.action,
            horizon=horizon,
            num_threads=self.threads,
        )

    def run_of(self, arm: Arm, seed: int, record: Record) -> Path:
        """Return the folder of a training."""
        return record.place("training", f"{arm.place}/{seed}", self._decided_by(arm, seed))

    def judged_place(self, arm: Arm, seed: int, record: Record) -> Path:
        """Return where the evaluation of a training lies."""
        judging = {"seeds": [self.first_episode, self.first_episode + self.episodes]}
        decided_by = {"training": self._decided_by(arm, seed), **judging}
        return record.place("evaluations", f"{arm.place}/{seed}", decided_by)

    def _decided_by(self, arm: Arm, seed: int) -> dict[str, Any]:
        """Return all that decides a training."""
        return {
            "arm": asdict(arm),
            "seed": seed,
            "algorithm": without_cadence(self.learner(arm)),
            "policy": described(self.policy),
            "worlds": self.num_envs,
            "horizon": self.horizon,
        }

    def _judged(self, arm: Arm, seed: int, record: Record, progress: bool) -> EvaluationResult:
        """Return the kept evaluation of a training, or train, fly and keep it."""
        judged = self.judged_place(arm, seed, record)
        if (judged / FILE_NAME).exists():
            return load_result(judged)
        policy = self._trained(arm, seed, record, progress)
        write_json(judged / HOLDING, asdict(self._held(arm, policy)))
        result = self._flown(arm, policy, range(self.first_episode, self.first_episode + self.episodes), progress)
        result.save(judged)
        return result

    def _trained(self, arm: Arm, seed: int, record: Record, progress: bool) -> ChunkPolicy:
        tuning = range(TUNING_SEEDS.start, TUNING_SEEDS.start + self.curve_episodes)
        env = self.environment(arm, self.num_envs, horizon=self.horizon)
        try:
            return self.learner(arm).train(
                None,
                self.policy,
                env=env,
                run=self.run_of(arm, seed, record),
                seed=seed,
                evaluate=lambda policy, step: {"success": self._flown(arm, policy, tuning, False).success["rate"]},
                progress=progress,
            )
        finally:
            env.close()

    def _flown(self, arm: Arm, policy: ChunkPolicy, seeds: range, progress: bool) -> EvaluationResult:
        env = self.environment(arm, min(50, len(seeds)))
        try:
            return evaluate(env, policy, seeds, policy_name=arm.place, progress=progress)
        finally:
            env.close()

    def _held(self, arm: Arm, policy: ChunkPolicy) -> Holding:
        seeds = self.first_episode + np.arange(min(HELD_SEEDS, self.episodes))
        env = self.environment(arm, len(seeds), horizon=HELD_STEPS)
        try:
            return hold(env, policy, seeds, steps=HELD_STEPS, watched=WATCHED_STEPS)
        finally:
            env.close()

    def _report(self, record: Record, results: Mapping[tuple[Arm, int], EvaluationResult]) -> Report:
        rows = {arm: self._row(arm, record, results) for arm in self.arms()}
        curves = {
            (f"{arm.action}, {arm.reward}", arm.label): [
                success_on_the_way(self.run_of(arm, seed, record)) for seed in self.seeds_of(arm)
            ]
            for arm in self.arms()
        }
        return Report(
            study=self,
            targets=self.targets_of(rows),
            tables={"Arms": list(rows.values()), "Single trainings": list(self._singles(record, results))},
            notes=NOTES,
            figures={"z1_reach.svg": success_curves(curves)},
            details={"failed_seeds": {f"{arm.place}/{seed}": failed_seeds(r) for (arm, seed), r in results.items()}},
            wall_time_s=spent_s((self.run_of(arm, seed, record) for arm, seed in results), results.values()),
        )

    def _row(self, arm: Arm, record: Record, results: Mapping[tuple[Arm, int], EvaluationResult]) -> Row:
        found = [results[arm, seed] for seed in self.seeds_of(arm)]
        runs = [self.run_of(arm, seed, record) for seed in self.seeds_of(arm)]
        holding = [self._holding(arm, seed, record) for seed in self.seeds_of(arm)]
        return {
            **_head(arm),
            **pooled_row(found),
            "time_s": _mean([_metric(result, "time_to_success_s") for result in found]),
            "jerk": _mean([_jerk(result) for result in found], digits=0),
            "fast_share": _mean([_metric(result, "action_fast_share") for result in found], digits=3),
            **{f"held_{key}": _mean([one[key] for one in holding], digits=3) for key in holding[0]},
            "train_min": _mean([own_time_s(run) / 60 for run in runs], digits=1),
        }

    def _singles(self, record: Record, results: Mapping[tuple[Arm, int], EvaluationResult]) -> Iterator[Row]:
        for (arm, seed), result in sorted(results.items(), key=lambda item: item[0]):
            won = {"seed": seed, "success": result.success["count"], "episodes": len(result.episodes)}
            held = {f"held_{key}": value for key, value in self._holding(arm, seed, record).items()}
            yield {**_head(arm), **won, "jerk": _mean([_jerk(result)], digits=0), **held}

    def _holding(self, arm: Arm, seed: int, record: Record) -> dict[str, float]:
        return json.loads((self.judged_place(arm, seed, record) / HOLDING).read_text())

    def targets_of(self, rows: Mapping[Arm, Row]) -> tuple[Target, ...]:
        """Return what the best algorithm is asked for, smooth, against itself without."""
        best, plain = (Arm(self.actions[0], self.rewards[0], self.algorithms[0], smooth) for smooth in (True, False))
        share, what = rows[best]["jerk"] / rows[plain]["jerk"], f"{best.label}, {best.action}"
        jerks = f"{rows[best]['jerk']:.0f} and {rows[plain]['jerk']:.0f}, {self.seeds} trainings each"
        return (
            pooled_target(f"{what}: success", 100.0, rows[best]),
            Target(f"{what}: jerk, of the plain one's", "at most", LARGEST_JERK_SHARE, share, "", jerks),
        )


def _head(arm: Arm) -> Row:
    return {"action": arm.action, "reward": arm.reward, "algorithm": arm.algorithm, "smooth": arm.smooth}


def _metric(result: EvaluationResult, name: str) -> float | None:
    return result.metrics[name]["mean"]


def _jerk(result: EvaluationResult) -> float | None:
    """Return the jerk of the arm's motion in an evaluation: that of the first unit, which is not the gripper's."""
    name = next(name for name in result.metrics if name.startswith("action_jerk_rms["))
    return _metric(result, name)


def _mean(values: Sequence[float | None], *, digits: int = 2) -> float | None:
    known = [value for value in values if value is not None]
    return round(sum(known) / len(known), digits) if known else None
