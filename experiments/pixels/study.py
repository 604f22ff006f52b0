"""The worth of cameras: policies that see images and the end effector's pose, but no object, on unseen seeds.

Beside each stands its blind control, the same network from the same demonstrations without the images: what that
reaches needs no eyes. Every stage is kept by all that decides it: killed at any moment, the same call continues.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import ClassVar

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.rendering import require_rendering
from aerial_il.core.specs import camera_name
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.network import PolicySettings
from experiments.common.demonstrations import NOISE, Source
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, bar
from experiments.common.seeds import EVALUATION_SEED, check_seeds
from experiments.common.stages import Cloned, Stages
from experiments.common.success import failed_seeds, pooled_row, spread_of

POSE = ("ee_pos", "ee_rot6d")
SEEING, BLIND = "images", "blind"
NOTES = (
    "The final policy of each training; trainings differ in their draw: in demonstrations (other seeds), weights and "
    "minibatches. Flights: Wilson's 95 % interval over the flights of these very policies. Trainings: Student's 95 % "
    "interval with a training as the unit.",
    "The policy sees the images named in the settings and the end effector's pose; poses of objects and targets are "
    "hidden from it. Blind: the same without images.",
    "Busy: fraction of the training time that was not spent waiting for minibatches.",
)


@dataclass(frozen=True, kw_only=True)
class Pixels:
    """Settings.

    Attributes:
        policy: what is trained; it names the cameras. algorithm: how. noise: of the expert that demonstrates.
        robot, tasks: which cells. demos: demonstrations per task. image_size: height and width, pixels.
        tier: in which all is flown. draws: of demonstrations and weights, one training each.
        episodes: unseen seeds per evaluation. first_episode: the first of them. num_envs: worlds flown at once.
        threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "pixels"
    question: ClassVar[str] = "How well does behaviour cloning fly on camera images alone, and at what cost?"

    policy: PolicySettings = MLP(obs_names=POSE, images=("wrist_rgb", "base_rgb"), masked_fields=())
    algorithm: BC = BC(steps=8_000, batch_size=64, threads=2)
    noise: float = NOISE
    robot: str = "fa_hexa_arm4"
    tasks: tuple[str, ...] = ("reach", "press_button", "pick_place")
    demos: int = 80
    image_size: tuple[int, int] = (64, 64)
    tier: str = "calm"
    draws: tuple[int, ...] = (0, 1, 2)
    episodes: int = 100
    first_episode: int = EVALUATION_SEED
    num_envs: int = 50
    threads: int = 0

    def __post_init__(self) -> None:
        if not self.policy.images:
            raise InvalidValueError("The policy sees no images; name some, e.g. bench.policy.images=[wrist_rgb].")
        if self.demos < 1 or self.episodes < 1 or not self.draws:
            raise InvalidValueError(
                f"demos and episodes start at 1, got {self.demos} and {self.episodes}; draws name at least one."
            )
        check_seeds(self.first_episode, self.episodes)

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Collect, train and evaluate what ``folder`` does not hold yet; see :class:`Study`."""
        require_rendering("bench pixels")
        stages = Stages(record=Record(folder), num_envs=self.num_envs, threads=self.threads, progress=progress)
        seeds, trainings = range(self.first_episode, self.first_episode + self.episodes), list(self.all_trainings())
        results = {t: stages.judged(t, self.tier, seeds) for t in bar(trainings, self.name, progress)}
        rows = list(table_rows(results, stages))
        return Report(
            study=self,
            targets=tuple(targets_of(rows)),
            tables={"Success on images": rows},
            notes=(*NOTES, *stages.record.notes()),
            details={"failed_seeds": {training.label: failed_seeds(r) for training, r in results.items()}},
            wall_time_s=stages.seconds(),
        )

    def all_trainings(self) -> Iterator[Cloned]:
        """Yield what is trained, draw by draw: each policy and its blind control."""
        policies = {SEEING: self.policy, BLIND: replace(self.policy, images=())}
        cameras = tuple(map(camera_name, self.policy.images))
        for draw, task, (sight, policy) in product(self.draws, self.tasks, policies.items()):
            source = Source(
                robot=self.robot,
                task=task,
                tier=self.tier,
                noise=self.noise,
                draw=draw,
                cameras=cameras,
                image_size=self.image_size,
            )
            yield Cloned(sight, source, self.demos, policy, self.algorithm)


def table_rows(results: Mapping[Cloned, EvaluationResult], stages: Stages) -> Iterator[Row]:
    """Yield a row for each task and sight."""
    arms: dict[tuple[str, str], list[Cloned]] = {}
    for training in results:
        arms.setdefault((training.source.task, training.method), []).append(training)
    for (task, sight), found in arms.items():
        pooled = pooled_row(results[training] for training in found)
        busy = [_busy_percent(stages.run_of(training)) for training in found]
        cost = {"train_min": stages.minutes(found), "busy": round(sum(busy) / len(busy), 1)}
        yield {"task": task, "sees": sight, **pooled, **cost}


def _busy_percent(run: Path) -> float:
    """Return the share of a training's time that was not spent waiting for minibatches."""
    rows = [row for row in read_metrics(run) if "wait_share" in row]
    elapsed = [0.0, *(row["elapsed_s"] for row in rows)]
    waited = sum(r["wait_share"] * (end - start) for r, start, end in zip(rows, elapsed, elapsed[1:], strict=False))
    return 100 * (1 - waited / elapsed[-1])


def targets_of(rows: Sequence[Row]) -> Iterator[Target]:
    """Yield that images must be worth something: the lower end with them above the upper end without."""
    arms = {(row["task"], row["sees"]): row for row in rows}
    for (task, sight), row in arms.items():
        if sight == SEEING:
            blind = arms[task, BLIND]
            what = f"{task}: lower end of its flights' interval, above the upper end of the blind control's"
            spread = f"{row['percent']:g} % ({spread_of(row)}) against {blind['percent']:g} %"
            yield Target(what, "at least", blind["flights_high"], row["flights_low"], "%", spread)
