"""Flying a bare quadrotor: reinforcement learning that commands thrust and body rates, beside tuned flight laws.

Proximal policy optimisation learns to hover, to take off and to land in gusts, from the environment's dense reward and
without a demonstration. PID, LQR and geometric control fly the same episodes, told what
to do by the scripted experts, and the same manoeuvres, with the target for their reference. Every stage is kept by all
that decides it: killed at any moment, the same call continues.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

import aerial_il
from aerial_il.algorithms.ppo import PPO
from aerial_il.core.composition import build
from aerial_il.core.contracts import Policy
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import write_json
from aerial_il.evaluation.result import FILE_NAME, EvaluationResult, load_result
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.policies import load_policy
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from experiments.common.figures import mismatch_lines, step_lines, success_curves
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, bar
from experiments.common.seeds import EVALUATION_SEED, TUNING_SEEDS
from experiments.common.stages import described, own_time_s, spent_s, without_cadence
from experiments.common.success import (
    failed_seeds,
    mean_time_s,
    pooled_row,
    pooled_target,
    success_on_the_way,
)
from experiments.flight_control.manoeuvres import (
    NOMINAL,
    STEPS,
    Mismatch,
    decision_us,
    hold,
    push,
    respond,
)
from experiments.flight_control.pilots import ROBOT, LawPilot, Pilot, PolicyPilot
from experiments.flight_control.tables import (
    HELD_IN,
    MASSES,
    MOTORS,
    by_mismatch,
    drawn_responses,
    drawn_times,
    manoeuvre_tables,
)

LAWS, LEARNERS, TASKS = ("pid", "lqr", "geometric", "geometric_observer"), ("ppo",), ("hover", "take_off", "land")
HOVER, OWN_TIER, TIERS = "hover", "gusts", ("calm", "gusts")
WANTED_PERCENT = 90.0  # of flights by the best learner, on each task in gusts
MANOEUVRES = "manoeuvres.json"
NOTES = (
    "Learners are paid by the environment's dense reward, have no demonstration and command collective thrust and body "
    "rates 50 times a second, which the vehicle follows 250 times a second; they have learned in gusts. Trainings "
    "differ in weights and in the episodes they fly; the entropy bonus is smaller in `land`. Judged is the final "
    "policy. Laws command the rotors 250 times a second; the scripted expert of the task tells them where to go.",
    "Manoeuvres, all of `hover`: the mean of all seeds, of each training by itself and then of the trainings. Laws "
    "have the target for their reference, which jumps with it; no planner smooths the way. Forward 40 cm, up 30 cm, "
    "heading 30°, attitude: set at rest to a roll of 30°. Settling: to within 10 % for good. Push: a blow that "
    "gives 1 m/s sideways; recovered: within 5 cm for good. Empty: never within the 4 s watched, by at least one "
    "training.",
    "Holding: 10 s at the target. Power: mean of (thrust over hovering thrust)^1.5 of the rotors. Activity: root "
    "mean square rate of a rotor's thrust. Mass: with inertia, of the whole vehicle; motor: thrust of one rotor of "
    "four. Neither control laws nor policies are informed of the change. Distance, tilt, power and activity of a "
    "crashed flight are those up to the crash; in the figure the points of pilots some of whose flights crashed are "
    "hollow, and left out where most did.",
    "Minutes: of one training, flying and learning, mean over the trainings; flights on the way are not included.",
    "Decision: median time of one action of one vehicle called from Python, of a law its five ticks.",
    "The best learner of a task is chosen by its success on the very seeds that judge it: an optimistic choice, for "
    "which its interval is not corrected.",
)


@dataclass(frozen=True, order=True)
class Training:
    """One training: a task, an algorithm and a seed."""

    task: str
    algorithm: str
    seed: int

    @property
    def place(self) -> str:
        """Its name, a path."""
        return f"{self.task}/{self.algorithm}/{self.seed}"


SEEING = SquashedGaussian(hidden=(64, 64), masked_fields=("base_pos", "ee_*", "target_*", "pad_pos"))
ON_POLICY = build(
    PPO,
    {
        "steps": 4_000_000, "rollout": {"steps": 8_192, "epochs": 6, "batch_size": 2_048}, "entropy": 0.01,
        "target_kl": 0.015, "lr": 0.0005, "gamma": 0.99, "critic_hidden": (128, 128),
        "smoothness": {"rate_penalty": 0.05},
        "cadence": {"evaluate_every": 500_000, "checkpoint_every": 500_000, "keep_checkpoints": 1},
    },
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class FlightControl:
    """Settings.

    Attributes:
        policy: what is trained. ppo: how. learners: ``ppo``, or none. laws: flight laws.
        action: level at which learners act. seeds: trainings on each task.
        entropy: its weight for tasks that need another one than the others.
        horizon: steps of a learning episode. ppo_envs: worlds that learn.
        episodes: unseen seeds that judge.
        first_episode: the first of them. curve_episodes: tuning seeds flown on the way.
        flights: worlds of a manoeuvre. threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "flight_control"
    question: ClassVar[str] = "Does reinforcement learning fly a bare quadrotor as well as a tuned flight law?"

    policy: SquashedGaussian = SEEING
    ppo: PPO = ON_POLICY
    learners: tuple[str, ...] = LEARNERS
    laws: tuple[str, ...] = LAWS
    action: str = "ctbr"
    seeds: int = 3
    entropy: Mapping[str, float] = field(default_factory=lambda: {"land": 0.003})
    horizon: int = 200
    ppo_envs: int = 64
    episodes: int = 100
    first_episode: int = EVALUATION_SEED
    curve_episodes: int = 50
    flights: int = 16
    threads: int = 1

    def __post_init__(self) -> None:
        for what, known in (("learners", LEARNERS), ("laws", LAWS), ("entropy", TASKS)):
            if unknown := set(getattr(self, what)) - set(known):
                raise InvalidValueError(f"{what} names {sorted(unknown)}; valid: {', '.join(known)}.")
        if min(self.seeds, self.episodes) < 1 or self.flights < 2:
            raise InvalidValueError("seeds and episodes start at 1, flights at 2.")

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Train, judge and fly what ``folder`` does not hold yet; see :class:`Study`."""
        record = Record(folder)
        results = {key: self._judged(*key, record, progress) for key in bar(self._work(), self.name, progress)}
        flown = {
            name: [self._manoeuvres(name, pilot, record) for pilot in pilots]
            for name, pilots in bar(list(self._pilots(record).items()), "manoeuvres", progress)
        }
        return self._report(record, results, flown)

    def trainings(self) -> list[Training]:
        """Return all trainings, the first seed of each first."""
        every = [training for task, by in product(TASKS, self.learners) for training in self.trainings_of(task, by)]
        return sorted(every, key=lambda training: training.seed)

    def trainings_of(self, task: str, learner: str) -> list[Training]:
        """Return the trainings of a learner on a task."""
        return [Training(task, learner, seed) for seed in range(self.seeds)]

    def _work(self) -> list[tuple[Training | tuple[str, str], str]]:
        """Return what is judged: a training's policy or a (task, law), and in which tier."""
        return [*product(self.trainings(), TIERS), *product(product(TASKS, self.laws), TIERS)]

    def learner(self, training: Training) -> PPO:
        """Return the algorithm of a training."""
        return replace(self.ppo, entropy=self.entropy.get(training.task, self.ppo.entropy))

    def run_of(self, training: Training, record: Record) -> Path:
        """Return the folder of a training."""
        return record.place("training", training.place, self._decided_by(training))

    def _decided_by(self, training: Training) -> dict[str, Any]:
        """Return all that decides a training."""
        return {
            "lesson": asdict(training),
            "action": self.action,
            "algorithm": without_cadence(self.learner(training)),
            "policy": described(self.policy),
            "worlds": self.ppo_envs,
            "horizon": self.horizon,
        }

    def _judged(self, flier: Training | tuple[str, str], tier: str, record: Record, progress: bool) -> EvaluationResult:
        """Return the kept evaluation of a policy or a law, or fly and keep it."""
        task, label = (flier.task, flier.place) if isinstance(flier, Training) else (flier[0], "/".join(flier))
        what = self._decided_by(flier) if isinstance(flier, Training) else {"law": flier[1]}
        seeds = range(self.first_episode, self.first_episode + self.episodes)
        judged = {"what": what, "tier": tier, "seeds": [seeds.start, seeds.stop]}
        place = record.place("evaluations", f"{label}/{tier}", judged)
        if (place / FILE_NAME).exists():
            return load_result(place)
        if isinstance(flier, Training):
            policy: Policy = self._trained(flier, record, progress)
            result = self._flown(task, policy, tier, seeds, action=self.action)
        else:
            result = self._flown(task, aerial_il.expert(ROBOT, task), tier, seeds, controller=flier[1])
        result.save(place)
        return result

    def _trained(self, training: Training, record: Record, progress: bool) -> Policy:
        run = self.run_of(training, record)
        if (run / "policy").is_dir():
            return load_policy(run)
        tuning = range(TUNING_SEEDS.start, TUNING_SEEDS.start + self.curve_episodes)
        env = aerial_il.load_batch(
            ROBOT, training.task, num_envs=self.ppo_envs, tier=OWN_TIER, action=self.action,
            horizon=self.horizon, num_threads=self.threads,
        )  # fmt: skip

        def seen(policy: Policy, step: int) -> dict[str, float]:
            return {"success": self._flown(training.task, policy, OWN_TIER, tuning, action=self.action).success["rate"]}

        try:
            return self.learner(training).train(
                None, self.policy, env=env, run=run, seed=training.seed, evaluate=seen, progress=progress
            )
        finally:
            env.close()

    def _flown(
        self, task: str, policy: Policy, tier: str, seeds: range, *, action: str = "ee_pose", controller: str = LAWS[-1]
    ) -> EvaluationResult:
        env = aerial_il.load_batch(
            ROBOT, task, num_envs=min(50, len(seeds)), tier=tier, action=action, controller=controller,
            num_threads=self.threads,
        )  # fmt: skip
        try:
            return evaluate(env, policy, seeds, policy_name=task, progress=False)
        finally:
            env.close()

    def _pilots(self, record: Record) -> dict[str, list[Pilot]]:
        """Return who flies the manoeuvres: the laws, and of each learner what it has learned of hovering."""
        pilots: dict[str, list[Pilot]] = {law: [LawPilot(law)] for law in self.laws}
        for by in self.learners:
            runs = [self.run_of(training, record) for training in self.trainings_of(HOVER, by)]
            pilots[by] = [PolicyPilot(load_policy(run), self.action, run.name) for run in runs]
        return pilots

    def _manoeuvres(self, name: str, pilot: Pilot, record: Record) -> dict[str, Any]:
        """Return the kept figures of a pilot's manoeuvres, or fly them."""
        place = record.place("manoeuvres", f"{name}/{pilot.label}", {"worlds": self.flights})
        if not (place / MANOEUVRES).exists():
            place.mkdir(parents=True, exist_ok=True)
            write_json(place / MANOEUVRES, self._fly(pilot))
        return json.loads((place / MANOEUVRES).read_text())

    def _fly(self, pilot: Pilot) -> dict[str, Any]:
        """Fly all manoeuvres."""
        seeds, threads = self.first_episode + np.arange(self.flights), self.threads
        mismatches = {
            **{f"mass {factor}": Mismatch(mass=factor) for factor in MASSES},
            **{f"motor {factor}": Mismatch(motor=factor) for factor in MOTORS},
        }
        return {
            "responses": {step: respond(pilot, step, seeds, threads=threads).tolist() for step in STEPS},
            "push": [None if np.isnan(away) else away for away in push(pilot, seeds, threads=threads).tolist()],
            "held": {tier: asdict(hold(pilot, tier, seeds, threads=threads)) for tier in HELD_IN},
            "mismatch": {
                name: asdict(hold(pilot, "calm", seeds, threads=threads, mismatch=mismatch))
                for name, mismatch in {"nominal": NOMINAL, **mismatches}.items()
            },
            "decision_us": decision_us(pilot),
        }

    def _report(
        self,
        record: Record,
        results: Mapping[tuple[Training | tuple[str, str], str], EvaluationResult],
        flown: Mapping[str, list[dict[str, Any]]],
    ) -> Report:
        success = list(self._success(record, results))
        return Report(
            study=self,
            targets=tuple(self.targets_of(success)),
            tables={"Tasks": success, **manoeuvre_tables(flown)},
            notes=NOTES,
            figures={
                "steps.svg": step_lines(drawn_times(), drawn_responses(flown)),
                "mismatch.svg": mismatch_lines(by_mismatch(flown)),
                **({"learning.svg": success_curves(self._curves(record))} if self.learners else {}),
            },
            details={"failed_seeds": {f"{flier}, {tier}": failed_seeds(r) for (flier, tier), r in results.items()}},
            wall_time_s=spent_s((self.run_of(training, record) for training in self.trainings()), results.values()),
        )

    def _curves(self, record: Record) -> Mapping[tuple[str, str], list[list[tuple[float, float]]]]:
        """Return (task, algorithm) -> the learning curve of each of its trainings."""
        return {
            (task, by): [success_on_the_way(self.run_of(training, record)) for training in self.trainings_of(task, by)]
            for task, by in product(TASKS, self.learners)
        }

    def _success(
        self, record: Record, results: Mapping[tuple[Training | tuple[str, str], str], EvaluationResult]
    ) -> Iterator[Row]:
        """Yield success of each law and each learner on each task in each tier."""
        for task, tier in product(TASKS, TIERS):
            for law in self.laws:
                yield success_row_of(task, tier, law, [results[(task, law), tier]], [])
            for by in self.learners:
                trainings = self.trainings_of(task, by)
                seconds = [own_time_s(self.run_of(training, record)) for training in trainings]
                yield success_row_of(task, tier, by, [results[training, tier] for training in trainings], seconds)

    def targets_of(self, rows: list[Row]) -> Iterator[Target]:
        """Yield what the best learner is asked for on each task, in the gusts that it has learned in."""
        for task in TASKS:
            found = [r for r in rows if (r["task"], r["tier"]) == (task, OWN_TIER) and r["flown_by"] in self.learners]
            if best := max(found, key=lambda row: row["percent"], default=None):
                yield pooled_target(f"{task}, {OWN_TIER}: {best['flown_by']}, the best learner", WANTED_PERCENT, best)


def success_row_of(task: str, tier: str, name: str, found: list[EvaluationResult], training_s: Sequence[float]) -> Row:
    """Return the row of a law, or of a learner whose trainings took ``training_s``."""
    return {
        "task": task,
        "tier": tier,
        "flown_by": name,
        **pooled_row(found),
        "time_s": mean_time_s(found),
        "crashes": sum(result.metrics["ends"]["crash"] for result in found),
        "minutes": round(float(np.mean(training_s)) / 60, 1) if training_s else None,
    }
