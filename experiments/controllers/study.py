"""Four flight laws side by side: step responses of the base, and how closely the tool follows under each."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import ClassVar

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.suite.scenario import Scenario
from aerial_il.suite.timing import CONTROL_DT_S
from experiments.common.figures import step_lines, tracking_bars
from experiments.common.report import Report, Row, Target, bar
from experiments.common.seeds import EVALUATION_SEED
from experiments.controllers.steps import SIZES, StepFigures, StepKind, fly_steps, step_figures
from experiments.tracking.study import LIMITS_CM, STUDIED, TASK, Tracking, tracking_rows

LARGEST_SETTLING_S: dict[StepKind, float] = {"position": 2.5, "yaw": 2.0}
LARGEST_OVERSHOOT_PERCENT: dict[StepKind, float] = {"position": 10.0, "yaw": 40.0}
DRAWN_S, DRAWN_EVERY = 3.0, 2  # of the response, and which of its control steps
NOTES = (
    "Steps: the reference of a hovering base jumps by 1 m forward or by 30 degrees, with the arm at rest, in calm "
    "air with sensor noise; mean response over all seeds. Rise: 10 to 90 %. Settling: until it stays within 5 % of "
    "the step. Offset: mean distance from the reference over the last fifth of the time.",
    "Tool RMSE: root mean square distance between tool and reference, as `aerial-il bench tracking` measures it.",
    "All laws share the whole-body planner, the arm's servos and the allocation (docs/controllers.md); within its "
    "reach the arm compensates for errors of the base.",
)

Key = tuple[str, StepKind, str]  # robot, step, flight law


@dataclass(frozen=True, kw_only=True)
class Controllers:
    """Settings.

    Attributes:
        robots: names; empty for those that the suite states figures for. controllers: flight laws. tiers: of the
            tracking. seeds: how many. seed: the first of them. settle_s: flown before measuring. step_s: watched after
            a step. tracking_s: tracking measured. threads: of the simulation; 0 for all cores.
    """

    name: ClassVar[str] = "controllers"
    question: ClassVar[str] = "How do the flight controllers differ?"

    robots: tuple[str, ...] = ()
    controllers: tuple[str, ...] = ("geometric_observer", "geometric", "pid", "lqr")
    tiers: tuple[str, ...] = ("calm", "gusts")
    seeds: int = 8
    seed: int = EVALUATION_SEED
    settle_s: float = 6.0
    step_s: float = 5.0
    tracking_s: float = 12.0
    threads: int = 0

    def __post_init__(self) -> None:
        if self.seeds < 1 or min(self.settle_s, self.step_s, self.tracking_s) <= 0.0:
            raise InvalidValueError(
                "controllers needs seeds >= 1, settle_s > 0, step_s > 0 and tracking_s > 0; got "
                f"{self.seeds}, {self.settle_s}, {self.step_s} and {self.tracking_s}."
            )

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Fly the steps and the motions under every law; see :class:`Study`."""
        started = time.perf_counter()
        cells = list(product(self.robots or STUDIED, self.controllers))
        responses: dict[Key, np.ndarray] = {
            (robot, kind, law): self._step(robot, kind, law)
            for robot, law in bar(cells, "controllers, steps", progress)
            for kind in SIZES
        }
        figures: dict[Key, StepFigures] = {
            key: step_figures(response, CONTROL_DT_S) for key, response in responses.items()
        }
        tracked = [row for cell in bar(cells, "controllers, tracking", progress) for row in self._track(*cell)]
        drawn = slice(0, round(DRAWN_S / CONTROL_DT_S), DRAWN_EVERY)
        percent: dict[Key, list[float]] = {
            key: [round(100.0 * float(y), 2) for y in found[drawn]] for key, found in responses.items()
        }
        return Report(
            study=self,
            targets=tuple(target for key, found in figures.items() for target in targets_of(*key, found)),
            tables={
                "Flight laws": [_summary(robot, law, figures, tracked) for robot, law in cells],
                "Step responses": [_step_row(*key, found) for key, found in figures.items()],
                "Tracking": tracked,
            },
            notes=NOTES,
            figures={
                "steps.svg": step_lines(times_row(drawn, self.step_s), _by_panel(percent)),
                "tracking.svg": tracking_bars(tracked, LIMITS_CM),
            },
            details={
                "time_s": times_row(drawn, self.step_s),
                **{", ".join(key): found for key, found in percent.items()},
            },
            wall_time_s=time.perf_counter() - started,
        )

    def _step(self, robot: str, kind: StepKind, law: str) -> np.ndarray:
        """(T,) mean response of all seeds."""
        scenario = Scenario(robot, TASK, "calm", "base_joint", controller=law)
        seeds = np.arange(self.seed, self.seed + self.seeds)
        return fly_steps(scenario, kind, seeds, settle_s=self.settle_s, step_s=self.step_s, threads=self.threads).mean(
            axis=1
        )

    def _track(self, robot: str, law: str) -> list[Row]:
        tracking = Tracking(
            seeds=self.seeds,
            seed=self.seed,
            settle_s=self.settle_s,
            duration_s=self.tracking_s,
            threads=self.threads,
        )
        return [row for tier in self.tiers for row in tracking_rows((robot, tier, law), tracking.fly(robot, tier, law))]


def _summary(robot: str, law: str, figures: Mapping[Key, StepFigures], tracked: list[Row]) -> Row:
    row: Row = {"robot": robot, "controller": law}
    for kind in SIZES:
        found = figures[robot, kind, law]
        row |= {f"{kind}_settling_s": found.settling_s, f"{kind}_overshoot_percent": found.overshoot_percent}
    mine = [r for r in tracked if (r["robot"], r["controller"]) == (robot, law)]
    return row | {f"{r['reference']}_{r['tier']}_cm": r["rmse_cm"] for r in mine}


def _step_row(robot: str, kind: StepKind, law: str, found: StepFigures) -> Row:
    return {"robot": robot, "step": kind, "controller": law, **asdict(found)}


def targets_of(robot: str, kind: StepKind, law: str, found: StepFigures) -> list[Target]:
    what = f"{robot}, {law}, {kind} step"
    return [
        Target(f"{what}: settling", "at most", LARGEST_SETTLING_S[kind], found.settling_s, "s"),
        Target(f"{what}: overshoot", "at most", LARGEST_OVERSHOOT_PERCENT[kind], found.overshoot_percent, "%"),
    ]


def times_row(drawn: slice, step_s: float) -> list[float]:
    """Times of the drawn control steps, s."""
    return [round(CONTROL_DT_S * (k + 1), 4) for k in range(round(step_s / CONTROL_DT_S))[drawn]]


def _by_panel(
    percent: Mapping[Key, list[float]],
) -> dict[tuple[str, str], dict[str, list[float]]]:
    panels: dict[tuple[str, str], dict[str, list[float]]] = {}
    for (robot, kind, law), values in percent.items():
        panels.setdefault((robot, f"{kind} step"), {})[law] = values
    return panels
