"""How often the experts succeed: every claimed cell in every tier, over seeds that nothing was tuned on."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import ClassVar

import aerial_il
from aerial_il.benchmarks.parts.claim import claim
from aerial_il.benchmarks.parts.figures import success_dots
from aerial_il.benchmarks.parts.progress import bar
from aerial_il.benchmarks.parts.report import Report, Row
from aerial_il.benchmarks.parts.returns import return_target, returns_row
from aerial_il.benchmarks.parts.stopwatch import Stopwatch
from aerial_il.benchmarks.parts.success import failed_seeds, success_row, success_target
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import write_json
from aerial_il.evaluation.result import FILE_NAME, EvaluationResult, load_result
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.suite import tiers

LIMITS_PERCENT = {"calm": 99.0, "breeze": 97.0, "gusts": 95.0, "hard": 85.0}
NOTES = (
    "Success must hold for the task's dwell with rotors and body untouched; an episode ends with it, a crash or the "
    "time limit.",
    "Intervals: Wilson's 95 % score interval. Targets are judged by the rate.",
    "Time: simulated seconds from reset to success, dwell included, mean and standard deviation over successes.",
    "Returns: mean sum of the dense reward over the whole time limit in calm air, success or not, on the same seeds; "
    "random actions are uniform within their bounds, each held for ten steps.",
)


@dataclass(frozen=True, kw_only=True)
class Experts:
    """Settings.

    Attributes:
        robots, tasks: names; empty for all. tiers: names. episodes: seeds flown per cell and tier. seed: the first of
            them; demonstrations and tuning use seeds from 0, evaluations those from 10000.
        returns: episodes per cell in which rewards are compared with those of random actions; 0 leaves them out.
        num_envs: worlds flown at once. threads: 0 for all cores.
    """

    name: ClassVar[str] = "experts"
    question: ClassVar[str] = "How often do the scripted experts succeed, on seeds that nothing was tuned on?"

    robots: tuple[str, ...] = ()
    tasks: tuple[str, ...] = ()
    tiers: tuple[str, ...] = ("calm", "breeze", "gusts", "hard")
    episodes: int = 200
    seed: int = 10_000
    returns: int = 16
    num_envs: int = 64
    threads: int = 0

    def __post_init__(self) -> None:
        for tier in self.tiers:
            tiers.get(tier)
        if self.episodes < 1 or self.num_envs < 1:
            raise InvalidValueError(f"episodes and num_envs start at 1, got {self.episodes} and {self.num_envs}.")

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Fly what ``folder`` does not hold yet, keeping each evaluation there; see :class:`Benchmark`."""
        settings = json.loads(json.dumps(asdict(self)))
        claim(folder, settings, free=("robots", "tasks", "tiers", "num_envs", "threads"))
        cells = [c for c in aerial_il.list_cells() if c[0] in (self.robots or c) and c[1] in (self.tasks or c)]
        clock = Stopwatch()
        with clock.section("all"):
            flights = list(product(cells, self.tiers))
            results = [self._result(*cell, tier, folder) for cell, tier in bar(flights, self.name, progress)]
            returns = [self._returns(*cell, folder) for cell in bar(cells, "returns", progress)] if self.returns else []
        rows = [{"robot": r.robot, "task": r.task, "tier": r.tier, **success_row(r)} for r in results]
        judged = [row for row in rows if row["tier"] in LIMITS_PERCENT]
        return Report(
            name=self.name,
            question=self.question,
            settings=settings,
            targets=(
                *(success_target(_name(row), LIMITS_PERCENT[row["tier"]], row) for row in judged),
                *(return_target(row) for row in returns),
            ),
            tables={"Success of the experts": rows} | ({"Returns": returns} if returns else {}),
            notes=NOTES,
            figures={"experts.svg": success_dots(rows, LIMITS_PERCENT)},
            details={"failed_seeds": {f"{r.robot}, {r.task}, {r.tier}": failed_seeds(r) for r in results}},
            wall_time_s=clock.seconds["all"],
        )

    def _result(self, robot: str, task: str, tier: str, folder: Path) -> EvaluationResult:
        kept = folder / f"{robot}-{task}-{tier}"
        if (kept / FILE_NAME).exists():
            return load_result(kept)
        worlds = min(self.num_envs, self.episodes)
        env = aerial_il.load_batch(robot, task, num_envs=worlds, tier=tier, num_threads=self.threads)
        try:
            seeds = range(self.seed, self.seed + self.episodes)
            result = evaluate(env, aerial_il.expert(robot, task), seeds, policy_name="expert", progress=False)
        finally:
            env.close()
        result.save(kept)
        return result

    def _returns(self, robot: str, task: str, folder: Path) -> Row:
        kept = folder / "returns" / f"{robot}-{task}.json"
        if not kept.exists():
            kept.parent.mkdir(parents=True, exist_ok=True)
            row = returns_row(robot, task, seed=self.seed, episodes=self.returns, threads=self.threads)
            write_json(kept, row)
        return json.loads(kept.read_text())


def _name(row: Row) -> str:
    return f"{row['robot']}, {row['task']}, {row['tier']}: success"


BENCHMARK = Experts
