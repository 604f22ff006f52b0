"""What cameras are worth: policies that see images and the end effector's pose, but no object, on unseen seeds.

Demonstrations are recorded through the policy's cameras once per task. Every stage leaves its result in the folder of
the benchmark: killed at any moment, the same call continues.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import aerial_il
from aerial_il.algorithms.bc import BehaviourCloning
from aerial_il.algorithms.parts.run_folder import read_metrics
from aerial_il.benchmarks.parts.claim import claim
from aerial_il.benchmarks.parts.progress import bar
from aerial_il.benchmarks.parts.report import Report, Row, Target
from aerial_il.benchmarks.parts.success import failed_seeds, success_row
from aerial_il.collection.collect import collect
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.policy import Policy
from aerial_il.core.rendering import require_rendering
from aerial_il.data.folder import LOG, DatasetFolder
from aerial_il.evaluation.result import FILE_NAME, EvaluationResult, load_result
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.policies.mlp import MlpConfig
from aerial_il.policies.parts.network import PolicyConfig
from aerial_il.suite.batch import BatchEnvironment

EVALUATION_SEED, BUSY_PERCENT = 10_000, 90.0
POSE = ("ee_pos", "ee_rot6d")
NOTES = (
    "One training run per task, its final policy; the interval is that of the evaluation (Wilson, 95 %) and does not "
    "cover the spread between training seeds.",
    "The policy sees the images named in the settings and the end effector's pose; poses of objects and targets are "
    "hidden from it.",
    "Busy: share of the time of optimisation steps that was not spent waiting for minibatches, in all.",
)


@dataclass(frozen=True, kw_only=True)
class Pixels:
    """Settings.

    Attributes:
        policy: what is trained; it names the cameras. algorithm: how. robot, tasks: which cells.
        demos: demonstrations per task. image_size: height and width, pixels. tier: in which all is flown.
        noise: of the expert while it demonstrates. episodes: unseen seeds per evaluation.
        seed: first of the demonstrations, and seed of the training.
        num_envs: worlds flown at once. threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "pixels"
    question: ClassVar[str] = "How well does behaviour cloning fly on camera images alone, and at what cost?"

    policy: PolicyConfig = field(default_factory=lambda: MlpConfig(obs_names=POSE, images=("wrist_rgb", "base_rgb")))
    algorithm: BehaviourCloning = field(default_factory=lambda: BehaviourCloning(batch_size=64))
    robot: str = "fa_hexa_arm4"
    tasks: tuple[str, ...] = ("reach", "press_button", "pick_place")
    demos: int = 80
    image_size: tuple[int, int] = (64, 64)
    tier: str = "calm"
    noise: float = 0.3
    episodes: int = 100
    seed: int = 0
    num_envs: int = 50
    threads: int = 0

    def __post_init__(self) -> None:
        if not self.policy.images:
            raise InvalidValueError("The policy sees no images; name some, e.g. bench.policy.images=[wrist_rgb].")
        if self.demos < 1 or self.episodes < 1:
            raise InvalidValueError(f"demos and episodes start at 1, got {self.demos} and {self.episodes}.")
        if self.seed + 2 * self.demos > EVALUATION_SEED:
            raise InvalidValueError(f"Demonstrations from seed {self.seed} on would run into the seeds of evaluation.")

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Collect, train and evaluate what ``folder`` does not hold yet; see :class:`Benchmark`."""
        require_rendering("bench pixels")
        claim(folder, self._plain(), free=("tasks",))
        results = {task: self._result(task, folder, progress) for task in bar(self.tasks, self.name, progress)}
        rows = [_row(folder, task, result) for task, result in results.items()]
        return Report(
            name=self.name,
            question=self.question,
            settings=self._plain(),
            targets=tuple(Target(f"{r['task']}: trainer busy", "at least", BUSY_PERCENT, r["busy"], "%") for r in rows),
            tables={"Success on images": rows},
            notes=NOTES,
            details={"failed_seeds": {task: failed_seeds(result) for task, result in results.items()}},
            wall_time_s=_seconds(folder, results),
        )

    def _result(self, task: str, folder: Path, progress: bool) -> EvaluationResult:
        """Return the evaluation of a task, doing what is left to do for it."""
        judged = folder / "evaluations" / task
        if (judged / FILE_NAME).exists():
            return load_result(judged)
        path, run = folder / "datasets" / task, folder / "training" / task
        self._collect(task, path, progress)
        dataset = aerial_il.open_dataset(str(path), cameras=self.policy.images)
        demos = dataset.only(dataset.uids[: self.demos])
        policy = self.algorithm.train(demos, self.policy, run=run, seed=self.seed, progress=progress)
        result = self._evaluate(task, policy, progress)
        result.save(judged)
        return result

    def _collect(self, task: str, path: Path, progress: bool) -> None:
        """Fly the expert until there are as many successes as wanted; a failure costs one more seed."""
        dataset, flown = DatasetFolder(path), self.demos
        while (missing := self.demos - len(dataset.files())) > 0:
            if flown > 2 * self.demos:
                raise InvalidValueError(f"{path}: the expert fails too often to give {self.demos} demonstrations.")
            env = self._environment(task, self.demos)
            try:
                expert = aerial_il.expert(self.robot, task, noise=self.noise)
                seeds = range(self.seed, self.seed + flown)
                collect(env, expert, seeds, path, settings={"noise": self.noise}, progress=progress)
            finally:
                env.close()
            flown += missing

    def _evaluate(self, task: str, policy: Policy, progress: bool) -> EvaluationResult:
        env, name = self._environment(task, self.episodes), f"{self.policy.name}, {self.demos} demonstrations"
        try:
            seeds = range(EVALUATION_SEED, EVALUATION_SEED + self.episodes)
            return evaluate(env, policy, seeds, policy_name=name, progress=progress)
        finally:
            env.close()

    def _environment(self, task: str, episodes: int) -> BatchEnvironment:
        return aerial_il.load_batch(
            self.robot,
            task,
            num_envs=min(self.num_envs, episodes),
            tier=self.tier,
            cameras=tuple(name.removesuffix("_rgb") for name in self.policy.images),
            image_size=self.image_size,
            num_threads=self.threads,
        )

    def _plain(self) -> dict[str, Any]:
        """The settings as JSON gives them back."""
        return json.loads(json.dumps({**asdict(self), "policy": {"name": self.policy.name, **self.policy.to_dict()}}))


def _row(folder: Path, task: str, result: EvaluationResult) -> Row:
    rows = [row for row in read_metrics(folder / "training" / task) if "wait_share" in row]
    elapsed = [0.0, *(row["elapsed_s"] for row in rows)]
    waited = sum(r["wait_share"] * (end - start) for r, start, end in zip(rows, elapsed, elapsed[1:], strict=False))
    training = {"train_steps": int(rows[-1]["step"]), "train_min": round(elapsed[-1] / 60, 2)}
    return {"task": task, **success_row(result), **training, "busy": round(100 * (1 - waited / elapsed[-1]), 1)}


def _seconds(folder: Path, results: Mapping[str, EvaluationResult]) -> float:
    """Return how long all stages took, whenever they were done."""
    logs = (
        json.loads(line) for task in results for line in (folder / "datasets" / task / LOG).read_text().splitlines()
    )
    training = sum(read_metrics(folder / "training" / task)[-1]["elapsed_s"] for task in results)
    flying = sum(result.provenance["wall_time_s"] for result in results.values())
    return sum(run["seconds"] for run in logs) + training + flying


BENCHMARK = Pixels
