"""How often the experts succeed: every claimed cell in every tier, over seeds that nothing was tuned on."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import ClassVar

import aerial_il
from aerial_il.benchmarks.parts.figures import success_dots
from aerial_il.benchmarks.parts.progress import bar
from aerial_il.benchmarks.parts.report import Report
from aerial_il.benchmarks.parts.success import failed_seeds, success_row, success_target
from aerial_il.core.errors import InvalidValueError
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.rollouts import evaluate

LIMITS_PERCENT = {"calm": 99.0, "gusts": 95.0}
NOTES = (
    "Success must hold for the task's dwell with rotors and body untouched; an episode ends with it, a crash or the "
    "time limit.",
    "Intervals: Wilson's 95 % score interval. Targets are judged by the rate.",
    "Time: simulated seconds from reset to success, dwell included, mean and standard deviation over successes.",
)


@dataclass(frozen=True, kw_only=True)
class Experts:
    """Settings.

    Attributes:
        tiers: names. episodes: seeds flown per cell and tier. seed: the first of them; demonstrations and tuning use
            seeds from 0, evaluations those from 10000. num_envs: worlds flown at once. threads: 0 for all cores.
    """

    name: ClassVar[str] = "experts"
    question: ClassVar[str] = "How often do the scripted experts succeed, on seeds that nothing was tuned on?"

    tiers: tuple[str, ...] = ("calm", "gusts")
    episodes: int = 200
    seed: int = 10_000
    num_envs: int = 64
    threads: int = 0

    def __post_init__(self) -> None:
        if self.episodes < 1 or self.num_envs < 1:
            raise InvalidValueError(f"episodes and num_envs start at 1, got {self.episodes} and {self.num_envs}.")

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Fly every cell in every tier and keep each evaluation in ``folder``; see :class:`Benchmark`."""
        started = time.perf_counter()
        flights = list(product(aerial_il.list_cells(), self.tiers))
        results = [self._fly(*cell, tier) for cell, tier in bar(flights, self.name, progress)]
        for result in results:
            result.save(folder / f"{result.robot}-{result.task}-{result.tier}")
        rows = [{"robot": r.robot, "task": r.task, "tier": r.tier, **success_row(r)} for r in results]
        return Report(
            name=self.name,
            question=self.question,
            settings=asdict(self),
            targets=tuple(
                success_target(f"{r['robot']}, {r['task']}, {r['tier']}: success", LIMITS_PERCENT[r["tier"]], r)
                for r in rows
                if r["tier"] in LIMITS_PERCENT
            ),
            tables={"Success of the experts": rows},
            notes=NOTES,
            figures={"experts.svg": success_dots(rows, LIMITS_PERCENT)},
            details={"failed_seeds": {f"{r.robot}, {r.task}, {r.tier}": failed_seeds(r) for r in results}},
            wall_time_s=time.perf_counter() - started,
        )

    def _fly(self, robot: str, task: str, tier: str) -> EvaluationResult:
        worlds = min(self.num_envs, self.episodes)
        env = aerial_il.load_batch(robot, task, num_envs=worlds, tier=tier, num_threads=self.threads)
        try:
            seeds = range(self.seed, self.seed + self.episodes)
            return evaluate(env, aerial_il.expert(robot, task), seeds, policy_name="expert", progress=False)
        finally:
            env.close()


BENCHMARK = Experts
