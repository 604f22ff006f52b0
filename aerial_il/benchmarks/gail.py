"""Imitation without reward: adversarial learners against the experts that they were shown, and against no one.

On Gymnasium's MuJoCo tasks experts are trained here, or were before, and their flights recorded; on the suite the
scripted experts demonstrate. Every learner is then given the first few of them, and no reward. Beside each stands the
same run without a demonstration: with flights of random actions in their place, and paid for being alive. Every stage
leaves its result in the folder of the benchmark: killed at any moment, the same call continues.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

import aerial_il
from aerial_il.algorithms.dac import DiscriminatorActorCritic
from aerial_il.algorithms.gail import AdversarialImitation
from aerial_il.algorithms.parts.learned_reward import reward_along, shuffled
from aerial_il.algorithms.parts.run_folder import read_metrics
from aerial_il.algorithms.parts.settings import Control, Imitating
from aerial_il.algorithms.sac import SoftActorCriticLearning
from aerial_il.benchmarks.parts.claim import claim
from aerial_il.benchmarks.parts.figures import reward_lines
from aerial_il.benchmarks.parts.progress import bar
from aerial_il.benchmarks.parts.ratios import peer_rows, peer_targets, row, targets
from aerial_il.benchmarks.parts.report import Report
from aerial_il.collection.collect import collect
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.policy import Policy
from aerial_il.data.episode import Episode
from aerial_il.data.folder import DatasetFolder
from aerial_il.evaluation.result import FILE_NAME, EvaluationResult, load_result
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.policies import load_policy
from aerial_il.policies.squashed_gaussian import SquashedGaussianConfig
from aerial_il.suite.outside.processes import processes_for

EVALUATION_SEED = 10_000
CONTROLS: tuple[Control, ...] = ("random_actions", "constant_reward")
EXPERT, EXPERTS = "expert", "experts"
CLONE = "clone alone"
NOTES = (
    "Experts of Gymnasium's tasks: soft actor-critic (of Walker2d: proximal policy optimisation, "
    "`experiments/gail/expert.py`), trained here, now or before; recorded and judged is their mean action.",
    "Learners never see a reward. The final policy of each training is judged on the expert's own fixed seeds.",
    "Ratio: mean return of the learner over that of the expert; its interval is a bootstrap (95 %) over episodes of "
    "all seeds, and covers neither the spread between trainings, which the table of single trainings shows, "
    "nor the expert's own.",
    "random_actions: the same run with flights of random actions in place of the demonstrations. constant_reward: the "
    "same run paid 1 for every step before an end. What these reach is no imitation.",
    "dac, and on the suite gail, begin with a clone; clone alone: the same run without a step of reinforcement. On "
    "Gymnasium's tasks gail begins with nothing, like the other library's; its worlds are shared among as many "
    "processes as there are cores, which changes its time and nothing else.",
    "On the suite gail learns from flights of a fixed length, which success does not end.",
    "On the suite all are judged like any policy: an episode ends with success. The interval of its rate is Wilson's "
    "(95 %).",
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


@dataclass(frozen=True, kw_only=True)
class Gail:
    """Settings.

    Attributes:
        policy: what is trained on Gymnasium's tasks. differs: method -> what is different in it there. expert: how
            their experts are trained.
        dac, gail: how learners are trained. methods: which of them on Gymnasium's tasks.
        apart: task -> what differs for it among ``steps`` of a learner, ``seeds`` and ``controls``.
        outside: Gymnasium's tasks. trajectories: demonstrations of each. subsample: keep each so manieth step of them.
        suite: tasks of our own, flown by ``robot``: task -> steps of a demonstration and of each flight while it
            learns, which success does not end. suite_policy, suite_gail: what differs on these, which ``gail`` learns.
        suite_demos: how many demonstrations. noise: of the expert there while it demonstrates.
        seeds: trainings of each arm. controls: trainings of each control run of a task's first method.
        episodes: flown to judge one. num_envs: worlds flown at once of Gymnasium's tasks; gail_envs, suite_envs: by
            ``gail`` there, and of the suite's. threads: of the suite's simulation, processes of Gymnasium's; 0 for all
            cores.
        experts: folder with experts of Gymnasium's tasks that were trained here before, one run for each, which are
            taken rather than trained anew. None to train all.
        peer: folder with results of another library, see ``experiments/gail/peer.py``; left out where it is missing.
    """

    name: ClassVar[str] = "gail"
    question: ClassVar[str] = (
        "How close does imitation without reward come to its expert, and what does it reach alone?"
    )

    policy: SquashedGaussianConfig = field(default_factory=SquashedGaussianConfig)
    differs: Mapping[str, Mapping[str, Any]] = field(default_factory=dict, hash=False)
    expert: SoftActorCriticLearning = field(default_factory=SoftActorCriticLearning)
    dac: DiscriminatorActorCritic = field(default_factory=DiscriminatorActorCritic)
    gail: AdversarialImitation = field(default_factory=AdversarialImitation)
    methods: tuple[str, ...] = ("dac",)
    apart: Mapping[str, Mapping[str, int]] = field(default_factory=dict, hash=False)
    outside: tuple[str, ...] = ("Hopper-v5", "HalfCheetah-v5", "Walker2d-v5")
    trajectories: int = 10
    subsample: int = 1
    suite: Mapping[str, int] = field(default_factory=lambda: {"reach": 250, "pick_place": 600}, hash=False)
    robot: str = "fa_hexa_arm4"
    suite_policy: Mapping[str, Any] = field(default_factory=dict, hash=False)
    suite_gail: Mapping[str, Any] = field(default_factory=dict, hash=False)
    suite_demos: int = 20
    noise: float = 0.1
    seeds: int = 3
    controls: int = 1
    episodes: int = 100
    num_envs: int = 8
    gail_envs: int = 32
    suite_envs: int = 64
    threads: int = 0
    experts: str | None = "experiments/gail/experts"
    peer: str = "experiments/gail/peer"

    def __post_init__(self) -> None:
        for method in self.methods:
            if method not in ("dac", "gail"):
                raise InvalidValueError(f"{method!r} is no method of this study; it has dac and gail.")
        for task, numbers in self.apart.items():
            if unknown := set(numbers) - {"steps", "seeds", "controls"}:
                raise InvalidValueError(f"apart.{task} names {sorted(unknown)}; valid: steps, seeds, controls.")
        if not self.methods or min(self.seeds, self.trajectories, self.suite_demos, self.episodes, self.num_envs) < 1:
            raise InvalidValueError("methods, seeds, demonstrations, episodes and num_envs start at 1.")

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Train, record and judge what ``folder`` does not hold yet; see :class:`Benchmark`."""
        free = ("methods", "outside", "suite", "seeds", "controls", "apart", "peer", "threads")
        claim(folder, self._plain(), free=free)
        experts = {task: self._expert(task, folder, progress) for task in (*self.outside, *self.suite)}
        results = {point: self._result(point, folder, progress) for point in bar(self.points(), self.name, progress)}
        return self._report(folder, experts, results)

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
        """What is trained on a task, what the targets are about first."""
        return (*(self.methods if task in self.outside else ("gail",)), CLONE)

    def environment(self, task: str, *, learner: str = "", judged: bool = False, at_most: int | None = None) -> Any:
        """Return worlds of a task, wherever it comes from: to demonstrate, to learn by a method or be ``judged`` in."""
        if task in self.outside:
            num_envs = self.gail_envs if learner == "gail" else self.num_envs
            num_envs = min(num_envs, at_most or num_envs)
            processes = processes_for(self.threads, num_envs)
            return aerial_il.load_gymnasium(task, num_envs=num_envs, processes=processes)
        num_envs, horizon = min(self.suite_envs, at_most or self.suite_envs), None if judged else self.suite[task]
        return aerial_il.load_batch(self.robot, task, num_envs=num_envs, horizon=horizon, num_threads=self.threads)

    def pilot(self, task: str, folder: Path) -> Policy:
        """Return the expert of a task: trained here, or scripted."""
        if task in self.outside:
            return load_policy(self._expert_run(task, folder))
        return aerial_il.expert(self.robot, task, noise=self.noise)

    def _expert_run(self, task: str, folder: Path) -> Path:
        """Return where the expert of one of Gymnasium's tasks is, or will be: kept from before, or below ``folder``."""
        return self._kept(task) or folder / EXPERTS / task

    def _kept(self, task: str) -> Path | None:
        kept = Path(self.experts) / task if self.experts else None
        return kept if kept is not None and (kept / "policy").is_dir() else None

    def _expert(self, task: str, folder: Path, progress: bool) -> EvaluationResult:
        """Train the expert of a task where there is none, and judge it."""
        if task in self.outside and self._kept(task) is None:
            env = self.environment(task)
            try:
                self.expert.train(None, self.policy, env=env, run=folder / EXPERTS / task, progress=progress)
            finally:
                env.close()
        return self._judged(task, self.pilot(task, folder), folder / "evaluations" / task / EXPERT, EXPERT, progress)

    def demonstrations(self, task: str, folder: Path, progress: bool) -> list[Episode]:
        """Return the first successful flights of the expert, recording what is missing."""
        dataset = DatasetFolder(folder / "datasets" / task)
        wanted = flown = self.trajectories if task in self.outside else self.suite_demos
        while (missing := wanted - len(dataset.files())) > 0:
            if flown > 4 * wanted:
                raise InvalidValueError(f"{dataset.path}: the expert fails too often to give {wanted} demonstrations.")
            env = self.environment(task, at_most=flown)
            try:
                collect(env, self.pilot(task, folder), range(flown), dataset.path, progress=progress)
            finally:
                env.close()
            flown += missing
        return list(islice(_successes(dataset.path), wanted))

    def _result(self, point: Point, folder: Path, progress: bool) -> EvaluationResult:
        judged = folder / "evaluations" / point.place
        if (judged / FILE_NAME).exists():
            return load_result(judged)
        env = self.environment(point.task, learner=point.method)
        try:
            policy = self._learner(point).train(
                self.demonstrations(point.task, folder, progress),
                self._policy(point),
                env=env,
                run=folder / "training" / point.place,
                seed=point.seed,
                progress=progress,
            )
        finally:
            env.close()
        return self._judged(point.task, policy, judged, str(point.place), progress)

    def _learner(self, point: Point) -> Any:
        """Return the algorithm of a training."""
        if point.task not in self.outside:
            learner = self._fitted(replace(self.gail, **self.suite_gail), point)
            return replace(learner, steps=learner.rollout, warmup=learner.rollout) if point.method == CLONE else learner
        if point.method == "gail":
            return self._fitted(replace(self.gail, subsample=self.subsample), point)
        learner = self._fitted(replace(self.dac, subsample=self.subsample), point)
        return replace(learner, steps=self.num_envs) if point.method == CLONE else learner

    def _fitted[Learner: Imitating](self, learner: Learner, point: Point) -> Learner:
        """Return ``learner`` with the length and the control of one training."""
        return replace(learner, steps=self._of(point.task, "steps", learner.steps), control=point.control)

    def _policy(self, point: Point) -> SquashedGaussianConfig:
        if point.task not in self.outside:
            return replace(self.policy, **self.suite_policy)
        return replace(self.policy, **self.differs.get("dac" if point.method == CLONE else point.method, {}))

    def _judged(self, task: str, policy: Policy, judged: Path, name: str, progress: bool) -> EvaluationResult:
        if (judged / FILE_NAME).exists():
            return load_result(judged)
        env = self.environment(task, judged=True, at_most=self.episodes)
        try:
            seeds = range(EVALUATION_SEED, EVALUATION_SEED + self.episodes)
            result = evaluate(env, policy, seeds, policy_name=name, progress=progress)
        finally:
            env.close()
        result.save(judged)
        return result

    def _report(
        self, folder: Path, experts: Mapping[str, EvaluationResult], results: Mapping[Point, EvaluationResult]
    ) -> Report:
        arms = dict.fromkeys((p.task, p.method, p.control) for p in results)
        rows = [row(task, EXPERT, "none", [result], result, []) for task, result in experts.items()]
        for arm in arms:
            points = [point for point in results if (point.task, point.method, point.control) == arm]
            runs = [folder / "training" / point.place for point in points]
            rows.append(row(*arm, [results[point] for point in points], experts[arm[0]], runs))
        rows += peer_rows(Path(self.peer), experts)
        singles = [
            row(p.task, p.method, p.control, [r], experts[p.task], [folder / "training" / p.place])
            for p, r in results.items()
        ]
        return Report(
            name=self.name,
            question=self.question,
            settings=self._plain(),
            targets=(
                *targets([found for found in rows if found["method"] == self._methods(found["task"])[0]]),
                *peer_targets(rows),
            ),
            tables={"Learners, controls and experts": rows, "Single trainings": singles},
            notes=NOTES,
            figures={"reward.svg": reward_lines(self._rewards(folder, results))},
            wall_time_s=_seconds(folder, list(experts.values()) + list(results.values()), results),
        )

    def _rewards(self, folder: Path, results: Mapping[Point, EvaluationResult]) -> dict[str, dict[str, np.ndarray]]:
        """Return the learned reward along a demonstration and along the same with its actions shuffled, per task."""
        panels = {}
        for point in results:
            if point.seed == 0 and point.control == "none" and point.method == self._methods(point.task)[0]:
                run, shown = folder / "training" / point.place, self.demonstrations(point.task, folder, False)[0]
                lines = {"demonstration": shown, "its actions shuffled": shuffled(shown)}
                panels[point.task] = {label: reward_along(run, episode) for label, episode in lines.items()}
        return panels

    def _plain(self) -> dict[str, Any]:
        """The settings as JSON gives them back."""
        return json.loads(json.dumps(asdict(self)))


def _successes(dataset: Path) -> Iterator[Episode]:
    return (episode for episode in aerial_il.open_dataset(str(dataset)) if episode.success)


def _seconds(folder: Path, evaluations: list[EvaluationResult], points: Mapping[Point, EvaluationResult]) -> float:
    """Return how long training and judging took, whenever it was done."""
    runs = [folder / "training" / point.place for point in points] + list((folder / EXPERTS).glob("*"))
    return sum(read_metrics(run)[-1]["elapsed_s"] for run in runs) + sum(
        result.provenance["wall_time_s"] for result in evaluations
    )


BENCHMARK = Gail
