"""Imitation without reward: adversarial learners against the experts that they were shown, and against no one.

On Gymnasium's MuJoCo tasks experts are trained here, or were before, and their flights recorded; on the suite the
scripted experts demonstrate. Every learner is then given the first few of them, and no reward. Beside each stands the
same run without a demonstration: with flights of random actions in their place, and paid for being alive. Trainings
of an arm differ in demonstrations and weights. Every stage is kept by all that decides it: killed at any moment, the
same call continues.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import metadata
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

import aerial_il
from aerial_il.algorithms.adversarial.reward_net import reward_along, shuffled
from aerial_il.algorithms.dac import DAC
from aerial_il.algorithms.gail import GAIL
from aerial_il.algorithms.online.demonstrations import Control
from aerial_il.algorithms.run.folder import REWARD
from aerial_il.algorithms.sac import SAC
from aerial_il.collection.collect import collect
from aerial_il.core.checkpoint import is_sealed
from aerial_il.core.composition import build, changed
from aerial_il.core.contracts import Policy
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import sha256_of
from aerial_il.data.episode import Episode
from aerial_il.data.folder import DatasetFolder
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.policies import FINAL, load_policy
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from aerial_il.presentation.svg import reward_lines
from aerial_il.suite.outside.processes import processes_for
from experiments.common.demonstrations import SEEDS_PER_DRAW
from experiments.common.record import Record
from experiments.common.report import Report, bar
from experiments.common.seeds import EVALUATION_SEED
from experiments.common.stages import described, judged_once, spent_s, without_cadence
from experiments.gail.ratios import LIKE, peer_rows, peer_targets, row, targets

CONTROLS: tuple[Control, ...] = ("random_actions", "constant_reward")
EXPERT, EXPERTS = "expert", "experts"
CLONE = "clone alone"
METHODS = ("dac", "gail", LIKE)
NOTES = (
    "Experts on Gymnasium's tasks: soft actor-critic (on Walker2d proximal policy optimisation, "
    "`experiments/gail/expert.py`), trained here, in this run or an earlier one; their mean actions are recorded and"
    " evaluated.",
    "Learners never see a reward. The final policy of each training is evaluated on the expert's own fixed seeds. "
    "The trainings of an arm differ in their demonstrations (flown with other seeds) and in their weights.",
    "Ratio: mean return of the learner over that of the expert; no interval covers the expert's own spread. Low and "
    "high: bootstrap (95 %) over the flights of these very policies. Trainings: Student's 95 % interval with a "
    "training as the unit.",
    f"{LIKE}: gail with as many worlds as the other library's published settings fly. The other library has the same "
    "demonstrations, steps and cores; published: its own tuned settings for Hopper, example: those of its tutorial.",
    "random_actions: the same run with flights of random actions in place of the demonstrations. constant_reward: "
    "the same run with a reward of 1 for every step before the end. What these runs reach is not due to imitation.",
    "dac, and gail on the suite, begin with a clone; clone alone: the same run without a single step of "
    "reinforcement learning. On Gymnasium's tasks gail begins from random weights, like the other library's; its "
    "worlds are divided among as many processes as there are cores, which changes its run time and nothing else.",
    "On the suite gail learns from flights of a fixed length, which success does not end.",
    "On the suite all are evaluated like any policy: an episode ends at success. The interval of the rate is "
    "Wilson's (95 %).",
)


@dataclass(frozen=True, order=True)
class Point:
    """One training: a task, a method, whether it is a control run, and a seed."""

    task: str
    method: str
    control: Control
    seed: int

    @property
    def place(self) -> Path:
        """Where its results lie below the folder of the benchmark."""
        return Path(self.task) / f"{self.method}{'' if self.control == 'none' else f'-{self.control}'}" / str(self.seed)


DIFFERS: Mapping[str, Mapping[str, Any]] = {
    "dac": {"hidden": (128, 128)},
    "gail": {"hidden": (64, 64), "activation": "tanh", "spread": "free"},
}
TEACHER = build(
    SAC,
    {
        "steps": 400_000, "warmup": 10_000, "replay": {"updates_per_step": 0.5, "batch_size": 128},
        "cadence": {"checkpoint_every": 20_000, "keep_checkpoints": 1},
    },
)  # fmt: skip
OFF_POLICY = build(
    DAC,
    {
        "steps": 120_000, "warmup": 10_000, "replay": {"updates_per_step": 0.5, "batch_size": 128}, "lr_floor": 0.0,
        "critics": {"hidden": (128, 128)}, "bc_pretrain_steps": 5_000, "bc_weight": 30.0,
        "reward": {"action_noise": True}, "cadence": {"checkpoint_every": 20_000, "keep_checkpoints": 1},
    },
)  # fmt: skip
ON_POLICY = build(
    GAIL,
    {
        "steps": 500_000, "rollout": {"steps": 4_096, "epochs": 4, "batch_size": 512}, "lr": 0.001,
        "reward": {"updates": 8}, "cadence": {"checkpoint_every": 100_000, "keep_checkpoints": 1},
    },
)  # fmt: skip
SUITE_POLICY: Mapping[str, Any] = {
    "relative": True, "anchor": "ee_pos", "masked_fields": ("base_*", "joint_*", "ee_*"), "spread": "free",
    "log_std": -3.0,
}  # fmt: skip
SUITE_GAIL: Mapping[str, Any] = {
    "steps": 512_000, "demonstrations": {"bounds": "demonstrations", "labels": "expert"}, "bc_pretrain_steps": 3_000,
    "warmup": 76_800, "rollout": {"steps": 25_600, "epochs": 5, "batch_size": 512}, "lr": 0.0001, "gamma": 0.97,
    "target_kl": 0.01, "critic_hidden": (256, 256), "reward": {"action_noise": True, "updates": 48},
}  # fmt: skip
APART: Mapping[str, Mapping[str, int]] = {
    "Hopper-v5": {"seeds": 3, "controls": 1},
    "HalfCheetah-v5": {"seeds": 3, "controls": 1},
    "Walker2d-v5": {"controls": 0},
    "pick_place": {"controls": 0},
}


@dataclass(frozen=True, kw_only=True)
class Gail:
    """Settings.

    Attributes:
        policy: what is trained on Gymnasium's tasks. differs: method -> what is different in it there. expert: how
            their experts are trained.
        dac, gail: how learners are trained. methods: which of them on Gymnasium's tasks.
        apart: task -> what differs for it among ``steps`` of a learner, ``seeds`` and ``controls``.
        outside: Gymnasium's tasks. trajectories: demonstrations of each. subsample: one of so many
            of their steps is kept.
        suite: tasks of our own, flown by ``robot``: task -> steps of a demonstration and of each flight while it
            learns, which success does not end. suite_policy, suite_gail: what differs on these, which ``gail`` learns.
        suite_demos: how many demonstrations. noise: of the expert there while it demonstrates.
        seeds: trainings of each arm. controls: trainings of each control run of a task's first method.
        episodes: flown to judge one.
        first_episode: the first of them. num_envs: worlds flown at once of Gymnasium's tasks; gail_envs, like_envs,
            suite_envs: by ``gail`` there, by its arm that flies as many as another library, and of the suite's.
            threads: of the suite's simulation, processes of Gymnasium's; 0 for all cores.
        experts: folder with experts of Gymnasium's tasks that were trained here before, one run for each, which are
            taken rather than trained anew. None to train all.
        peer: folder with results of another library, see ``experiments/gail/peer.py``; left out where it is missing.
    """

    name: ClassVar[str] = "gail"
    question: ClassVar[str] = (
        "How close does imitation without reward come to its expert, and what does it reach alone?"
    )

    policy: SquashedGaussian = SquashedGaussian()
    differs: Mapping[str, Mapping[str, Any]] = field(default_factory=lambda: dict(DIFFERS), hash=False)
    expert: SAC = TEACHER
    dac: DAC = OFF_POLICY
    gail: GAIL = ON_POLICY
    methods: tuple[str, ...] = ("dac", "gail", LIKE)
    apart: Mapping[str, Mapping[str, int]] = field(default_factory=lambda: dict(APART), hash=False)
    outside: tuple[str, ...] = ("Hopper-v5", "HalfCheetah-v5", "Walker2d-v5")
    trajectories: int = 10
    subsample: int = 1
    suite: Mapping[str, int] = field(default_factory=lambda: {"reach": 250, "pick_place": 600}, hash=False)
    robot: str = "fa_hexa_arm4"
    suite_policy: Mapping[str, Any] = field(default_factory=lambda: dict(SUITE_POLICY), hash=False)
    suite_gail: Mapping[str, Any] = field(default_factory=lambda: dict(SUITE_GAIL), hash=False)
    suite_demos: int = 20
    noise: float = 0.1
    seeds: int = 3
    controls: int = 1
    episodes: int = 100
    first_episode: int = EVALUATION_SEED
    num_envs: int = 16
    gail_envs: int = 32
    like_envs: int = 8
    suite_envs: int = 64
    threads: int = 0
    experts: str | None = "experiments/gail/experts"
    peer: str = "experiments/gail/peer"

    def __post_init__(self) -> None:
        for method in self.methods:
            if method not in METHODS:
                raise InvalidValueError(f"{method!r} is no method of this study; it has {', '.join(METHODS)}.")
        for task, numbers in self.apart.items():
            if unknown := set(numbers) - {"steps", "seeds", "controls"}:
                raise InvalidValueError(f"apart.{task} names {sorted(unknown)}; valid: steps, seeds, controls.")
        if not self.methods or min(self.seeds, self.trajectories, self.suite_demos, self.episodes, self.num_envs) < 1:
            raise InvalidValueError("methods, seeds, demonstrations, episodes and num_envs start at 1.")

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Train, record and judge what ``folder`` does not hold yet; see :class:`Study`."""
        record = Record(folder)
        experts = {task: self._expert(task, record, progress) for task in (*self.outside, *self.suite)}
        results = {point: self._result(point, record, progress) for point in bar(self.points(), self.name, progress)}
        return self._report(record, experts, results)

    def points(self) -> list[Point]:
        """Return all trainings, the first seed of every arm first."""
        tasks = (*self.outside, *self.suite)
        learners = [
            Point(task, method, "none", seed)
            for task in tasks
            for method in self._methods(task)
            for seed in range(self._of(task, "seeds", self.seeds))
        ]
        empty = [
            Point(task, self._methods(task)[0], control, seed)
            for task in tasks
            for control in CONTROLS
            for seed in range(self._of(task, "controls", self.controls))
        ]
        return sorted(learners + empty, key=lambda point: point.seed)

    def _of(self, task: str, what: str, usual: int) -> int:
        """Return one of a task's numbers, where it differs from the ``usual``."""
        return self.apart.get(task, {}).get(what, usual)

    def _methods(self, task: str) -> tuple[str, ...]:
        """The trainings on a task, first those that the targets are about."""
        return (*(self.methods if task in self.outside else ("gail",)), CLONE)

    def environment(self, task: str, *, learner: str = "", judged: bool = False, at_most: int | None = None) -> Any:
        """Return worlds of a task, wherever it comes from: to demonstrate, to learn by a method or be ``judged`` in."""
        if task in self.outside:
            num_envs = min(self._worlds(learner), at_most or self._worlds(learner))
            processes = processes_for(self.threads, num_envs)
            return aerial_il.load_gymnasium(task, num_envs=num_envs, processes=processes)
        num_envs, horizon = min(self.suite_envs, at_most or self.suite_envs), None if judged else self.suite[task]
        return aerial_il.load_batch(self.robot, task, num_envs=num_envs, horizon=horizon, num_threads=self.threads)

    def pilot(self, task: str, record: Record) -> Policy:
        """Return the expert of a task: trained here, or scripted."""
        if task in self.outside:
            return load_policy(self.expert_run(task, record))
        return aerial_il.expert(self.robot, task, noise=self.noise)

    def expert_run(self, task: str, record: Record) -> Path:
        """Return where the expert of one of Gymnasium's tasks is, or will be: kept from before, or in the record."""
        decided_by = {"algorithm": without_cadence(self.expert), "policy": described(self.policy)}
        return self._kept(task) or record.place(EXPERTS, task, decided_by)

    def _kept(self, task: str) -> Path | None:
        kept = Path(self.experts) / task if self.experts else None
        return kept if kept is not None and (kept / "policy").is_dir() else None

    def _expert(self, task: str, record: Record, progress: bool) -> EvaluationResult:
        """Train the expert of a task where there is none, and judge it."""
        if task in self.outside and self._kept(task) is None:
            env = self.environment(task)
            try:
                self.expert.train(None, self.policy, env=env, run=self.expert_run(task, record), progress=progress)
            finally:
                env.close()
        judged = record.place("evaluations", f"{task}/{EXPERT}", self._flown_by(task, record) | self._judging)
        return self._judged(task, lambda: self.pilot(task, record), judged, EXPERT, progress)

    @property
    def _judging(self) -> dict[str, Any]:
        return {"seeds": [self.first_episode, self.first_episode + self.episodes]}

    def _flown_by(self, task: str, record: Record) -> dict[str, Any]:
        """Return what decides the expert's flights."""
        if task not in self.outside:
            return {"robot": self.robot, "noise": self.noise, "horizon": self.suite[task]}
        versions = {name: metadata.version(name) for name in ("gymnasium", "mujoco")}
        return {"expert": sha256_of(self.expert_run(task, record) / "policy" / "manifest.json"), **versions}

    def _shown_by(self, task: str, record: Record, draw: int) -> dict[str, Any]:
        """Return what decides the demonstrations of a draw."""
        return {"task": task, "draw": draw, **self._flown_by(task, record)}

    def demonstrations(self, task: str, draw: int, record: Record, progress: bool) -> list[Episode]:
        """Return the first successful flights of the expert in a draw, recording what is missing."""
        dataset = DatasetFolder(record.place("datasets", f"{task}/{draw}", self._shown_by(task, record, draw)))
        wanted = flown = self.trajectories if task in self.outside else self.suite_demos
        first = SEEDS_PER_DRAW * draw
        while (missing := wanted - len(dataset.files())) > 0:
            if flown > 4 * wanted:
                raise InvalidValueError(f"{dataset.path}: the expert fails too often to give {wanted} demonstrations.")
            env = self.environment(task, at_most=flown)
            try:
                collect(env, self.pilot(task, record), range(first, first + flown), dataset.path, progress=progress)
            finally:
                env.close()
            flown += missing
        return list(islice(_successes(dataset.path), wanted))

    def _result(self, point: Point, record: Record, progress: bool) -> EvaluationResult:
        judged = record.place("evaluations", str(point.place), self._decided_by(point, record) | self._judging)
        return self._judged(
            point.task, lambda: self._trained(point, record, progress), judged, str(point.place), progress
        )

    def _trained(self, point: Point, record: Record, progress: bool) -> Policy:
        env = self.environment(point.task, learner=point.method)
        try:
            return self.learner_of(point).train(
                self.demonstrations(point.task, point.seed, record, progress),
                self._policy(point),
                env=env,
                run=self.run_of(point, record),
                seed=point.seed,
                progress=progress,
            )
        finally:
            env.close()

    def run_of(self, point: Point, record: Record) -> Path:
        """Return the folder of a training."""
        return record.place("training", str(point.place), self._decided_by(point, record))

    def _decided_by(self, point: Point, record: Record) -> dict[str, Any]:
        """Return all that decides a training."""
        outside = point.task in self.outside
        return {
            "shown": self._shown_by(point.task, record, point.seed),
            "demos": self.trajectories if outside else self.suite_demos,
            "algorithm": without_cadence(self.learner_of(point)),
            "policy": described(self._policy(point)),
            "worlds": self._worlds(point.method) if outside else self.suite_envs,
        }

    def _worlds(self, method: str) -> int:
        """Return how many of Gymnasium's worlds a method flies at once."""
        return {"gail": self.gail_envs, LIKE: self.like_envs}.get(method, self.num_envs)

    def learner_of(self, point: Point) -> Any:
        """Return the algorithm of a training."""
        if point.task not in self.outside:
            learner = self._fitted(changed(self.gail, self.suite_gail), point)
            return (
                replace(learner, steps=learner.rollout.steps, warmup=learner.rollout.steps)
                if point.method == CLONE
                else learner
            )
        if point.method in ("gail", LIKE):
            return self._fitted(changed(self.gail, {"demonstrations": {"subsample": self.subsample}}), point)
        learner = self._fitted(changed(self.dac, {"demonstrations": {"subsample": self.subsample}}), point)
        return replace(learner, steps=self.num_envs) if point.method == CLONE else learner

    def _fitted[Learner: (DAC, GAIL)](self, learner: Learner, point: Point) -> Learner:
        """Return ``learner`` with the length and the control of one training."""
        steps = self._of(point.task, "steps", learner.steps)
        return changed(learner, {"steps": steps, "demonstrations": {"control": point.control}})

    def _policy(self, point: Point) -> SquashedGaussian:
        if point.task not in self.outside:
            return replace(self.policy, **self.suite_policy)
        method = {CLONE: "dac", LIKE: "gail"}.get(point.method, point.method)
        return replace(self.policy, **self.differs.get(method, {}))

    def _judged(
        self, task: str, policy: Callable[[], Policy], judged: Path, name: str, progress: bool
    ) -> EvaluationResult:
        """Return the kept evaluation, or that of the policy that is made then."""
        seeds = range(self.first_episode, self.first_episode + self.episodes)
        env = partial(self.environment, task, judged=True, at_most=self.episodes)
        return judged_once(judged, policy, env, seeds, name=name, progress=progress)

    def _report(
        self, record: Record, experts: Mapping[str, EvaluationResult], results: Mapping[Point, EvaluationResult]
    ) -> Report:
        arms = dict.fromkeys((p.task, p.method, p.control) for p in results)
        rows = [row(task, EXPERT, "none", [result], result, []) for task, result in experts.items()]
        for arm in arms:
            points = [point for point in results if (point.task, point.method, point.control) == arm]
            runs = [self.run_of(point, record) for point in points]
            rows.append(row(*arm, [results[point] for point in points], experts[arm[0]], runs))
        rows += peer_rows(Path(self.peer), experts)
        singles = [
            row(p.task, p.method, p.control, [r], experts[p.task], [self.run_of(p, record)]) for p, r in results.items()
        ]
        rewards = self._rewards(record, results)
        return Report(
            study=self,
            targets=(
                *targets(
                    [found for found in rows if found["method"] == self._methods(found["task"])[0]],
                    {found["task"]: found for found in rows if found["method"] == CLONE},
                ),
                *peer_targets(rows),
            ),
            tables={"Learners, controls and experts": rows, "Single trainings": singles},
            notes=NOTES,
            figures={"reward.svg": reward_lines(rewards)} if rewards else {},
            wall_time_s=spent_s(
                [*(self.run_of(p, record) for p in results), *(record.folder / EXPERTS).glob("*")],
                [*experts.values(), *results.values()],
            ),
        )

    def _rewards(self, record: Record, results: Iterable[Point]) -> dict[str, dict[str, np.ndarray]]:
        """Return the learned reward along a demonstration and along the same with its actions shuffled.

        Per task it is that of the first method's first training whose networks are kept, or the next method's.
        """
        shown: dict[str, Point] = {}
        for point in sorted(results, key=self._order):
            if point.control == "none" and point.method != CLONE and _keeps_networks(self.run_of(point, record)):
                shown.setdefault(point.task, point)
        panels = {}
        for task, point in shown.items():
            run, episode = self.run_of(point, record), self.demonstrations(task, point.seed, record, False)[0]
            lines = {"demonstration": episode, "its actions shuffled": shuffled(episode)}
            panels[f"{task}, {point.method}"] = {label: reward_along(run, each) for label, each in lines.items()}
        return panels

    def _order(self, point: Point) -> tuple[int, int, int]:
        tasks = (*self.outside, *self.suite)
        return tasks.index(point.task), self._methods(point.task).index(point.method), point.seed


def _keeps_networks(run: Path) -> bool:
    """Whether a run still has its networks: finished stages may be kept without them."""
    return all(is_sealed(run / part) for part in (FINAL, REWARD))


def _successes(dataset: Path) -> Iterator[Episode]:
    return (episode for episode in aerial_il.open_dataset(str(dataset)) if episode.success)
