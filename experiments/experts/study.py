"""Success of the experts: every supported robot and task in calm air, gusts and `hard`, on held-out seeds."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import aerial_il
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import write_json
from aerial_il.evaluation.result import FILE_NAME, EvaluationResult, load_result
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.suite import tiers
from experiments.common.figures import success_dots
from experiments.common.record import Record
from experiments.common.report import Report, Row, Target, bar
from experiments.common.seeds import EVALUATION_SEED, check_seeds
from experiments.common.success import failed_seeds, success_row, success_target
from experiments.experts.returns import returns_row

LIMITS_PERCENT = {"calm": 99.0, "gusts": 95.0}
HARD_PERCENT = {("big_four_z1", "inspect_contact"): 85.0}
HARD_PERCENT_ANYWHERE = {"insert_peg": 95.0}  # task -> on every robot
NOTES = (
    "Success must hold for the task's required time, with rotors and body touching nothing; an episode ends at "
    "success, at a crash or at the time limit.",
    "Intervals: Wilson's 95 % score interval over the flights. Targets apply to the rate; `hard` is flown for every "
    "robot and task, with targets for inspect_contact on big_four_z1 and for insert_peg on every robot.",
    "Same in: tiers in which the flights are the same bit for bit, for example because nothing is exposed to the "
    "wind. They are flown once and counted once.",
    "Time: simulated seconds from reset to success, including the required time; mean and standard deviation over "
    "successes.",
    "Returns, which have no targets: mean sum of the dense reward over the whole time limit in calm air, success or "
    "not, on the same seeds; random actions are uniform within their bounds, each held for ten steps.",
)


@dataclass(frozen=True, kw_only=True)
class Experts:
    """Settings.

    Attributes:
        robots, tasks: names; empty for all. tiers: names. episodes: seeds flown per cell and tier. seed: the first of
            them; demonstrations and tuning use seeds from 0, evaluations those from 20000.
        returns: episodes per cell in which rewards are compared with those of random actions; 0 leaves them out.
        num_envs: worlds flown at once. threads: 0 for all cores.
    """

    name: ClassVar[str] = "experts"
    question: ClassVar[str] = "How often do the scripted experts succeed on held-out seeds?"

    robots: tuple[str, ...] = ()
    tasks: tuple[str, ...] = ()
    tiers: tuple[str, ...] = ("calm", "gusts", "hard")
    episodes: int = 200
    seed: int = EVALUATION_SEED
    returns: int = 16
    num_envs: int = 64
    threads: int = 0

    def __post_init__(self) -> None:
        for tier in self.tiers:
            tiers.get(tier)
        if self.episodes < 1 or self.num_envs < 1:
            raise InvalidValueError(f"episodes and num_envs start at 1, got {self.episodes} and {self.num_envs}.")
        check_seeds(self.seed, self.episodes)

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Fly what ``folder`` does not hold yet, keeping each evaluation there; see :class:`Study`."""
        record = Record(folder)
        cells = [c for c in aerial_il.list_cells() if c[0] in (self.robots or c) and c[1] in (self.tasks or c)]
        rows, failed, seconds = [], {}, 0.0
        for robot, task in bar(cells, self.name, progress):
            flown = {tier: self._result(robot, task, tier, record) for tier in self.tiers}
            for tier, same in distinct(flown).items():
                result = flown[tier]
                rows.append(
                    {"robot": robot, "task": task, "tier": tier, "same_in": ", ".join(same), **success_row(result)}
                )
                failed[f"{robot}, {task}, {tier}"] = failed_seeds(result)
                seconds += result.provenance["wall_time_s"]
        returns = [self._returns(*cell, record) for cell in bar(cells, "returns", progress)] if self.returns else []
        return Report(
            study=self,
            targets=tuple(targets_of(rows)),
            tables={"Success of the experts": rows} | ({"Returns": returns} if returns else {}),
            notes=NOTES,
            figures={"experts.svg": success_dots(rows, LIMITS_PERCENT)},
            details={"failed_seeds": failed},
            wall_time_s=seconds,
        )

    def _result(self, robot: str, task: str, tier: str, record: Record) -> EvaluationResult:
        seeds = range(self.seed, self.seed + self.episodes)
        decided_by = {"seeds": [seeds.start, seeds.stop]}
        kept = record.place("evaluations", f"{robot}-{task}/{tier}", decided_by)
        if (kept / FILE_NAME).exists():
            return load_result(kept)
        worlds = min(self.num_envs, self.episodes)
        env = aerial_il.load_batch(robot, task, num_envs=worlds, tier=tier, num_threads=self.threads)
        try:
            result = evaluate(env, aerial_il.expert(robot, task), seeds, policy_name="expert", progress=False)
        finally:
            env.close()
        result.save(kept)
        return result

    def _returns(self, robot: str, task: str, record: Record) -> Row:
        decided_by = {"seed": self.seed, "episodes": self.returns}
        kept = record.place("returns", f"{robot}-{task}", decided_by) / "row.json"
        if not kept.exists():
            write_json(kept, returns_row(robot, task, seed=self.seed, episodes=self.returns, threads=self.threads))
        return json.loads(kept.read_text())


def distinct(flown: Mapping[str, EvaluationResult]) -> Mapping[str, list[str]]:
    """Return the tiers that were flown differently -> the further ones in which the flights were the same."""
    alike: list[list[str]] = []
    for tier, result in flown.items():
        same = next((group for group in alike if flown[group[0]].episodes == result.episodes), None)
        alike.append([tier]) if same is None else same.append(tier)
    return {first: further for first, *further in alike}


def targets_of(rows: list[Row]) -> Iterator[Target]:
    """Yield what was asked for, of each cell and tier."""
    for row in rows:
        limit = LIMITS_PERCENT.get(row["tier"])
        if row["tier"] == "hard":
            limit = HARD_PERCENT.get((row["robot"], row["task"]), HARD_PERCENT_ANYWHERE.get(row["task"]))
        if limit is not None:
            yield success_target(f"{row['robot']}, {row['task']}, {row['tier']}: success", limit, row)
