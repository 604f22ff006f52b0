"""Step responses of the base: its reference jumps, by a metre or by thirty degrees, and the flight law follows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from aerial_il.control import controller_state
from aerial_il.core.errors import InvalidValueError
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.scenario import Scenario

StepKind = Literal["position", "yaw"]
SIZES: dict[StepKind, float] = {"position": 1.0, "yaw": np.deg2rad(30.0)}  # m forward; rad
START = np.array([-0.5, 0.0, 1.5])  # m, world
SETTLED = 0.05  # share of the step


@dataclass(frozen=True)
class StepFigures:
    """A step response in the usual four numbers.

    Attributes:
        rise_s: from 10 % to 90 %. overshoot_percent: of the step, 0 if it never gets there. settling_s: until it stays
            within 5 %. offset_percent: mean distance from the reference over the last fifth.
    """

    rise_s: float
    overshoot_percent: float
    settling_s: float
    offset_percent: float


def step_figures(response: np.ndarray, dt: float) -> StepFigures:
    """Measure a response.

    Args:
        response: (T,) share of the step that has been made, ``dt`` s, 2 ``dt``, ... after it.

    Raises:
        InvalidValueError: it does not come within 5 % of the step to stay.
    """
    outside = np.flatnonzero(np.abs(response - 1.0) > SETTLED)
    settled = 0 if outside.size == 0 else int(outside[-1]) + 1
    if settled == len(response):
        raise InvalidValueError(f"The response does not settle within {len(response) * dt:g} s: it ends at "
                                f"{100.0 * response[-1]:.0f} % of the step.")  # fmt: skip
    first = [int(np.argmax(response >= level)) for level in (0.1, 0.9)]
    last = response[-max(1, len(response) // 5) :]
    return StepFigures(
        rise_s=round((first[1] - first[0]) * dt, 4),
        overshoot_percent=round(max(0.0, 100.0 * float(response.max() - 1.0)), 3),
        settling_s=round(settled * dt, 4),
        offset_percent=round(100.0 * abs(float(last.mean() - 1.0)), 3),
    )


def fly_steps(
    scenario: Scenario, kind: StepKind, seeds: np.ndarray, *, settle_s: float, step_s: float, threads: int = 0
) -> np.ndarray:
    """Let the reference of the base jump and watch.

    Args:
        scenario: at the level ``base_joint``. kind: which step. seeds: (W,) one world each. settle_s: hovered before.
        step_s: watched after. threads: of the simulation, 0 for all cores.

    Returns:
        (T, W) share of the step that has been made, at each control step after the jump.
    """
    env = BatchEnvironment(scenario, len(seeds), threads)
    try:
        env.reset(seeds)
        joints = scenario.robot.vehicle.rest_down
        action = np.tile(np.array([*START, 0.0, *joints, 1.0]), (len(seeds), 1))
        for _ in range(round(settle_s / env.spec.control_dt_s)):
            env.step(action)
        jump(env, action, kind)
        found = []
        for _ in range(round(step_s / env.spec.control_dt_s)):
            env.step(action)
            found.append(_made(env, kind))
        return np.stack(found)
    finally:
        env.close()


def jump(env: BatchEnvironment, action: np.ndarray, kind: StepKind) -> None:
    """Move the reference itself, and the command with it: the controller would only let it travel there."""
    entry, start = (controller_state.BASE_POS, START[0]) if kind == "position" else (controller_state.BASE_YAW, 0.0)
    action[:, 0 if kind == "position" else 3] = start + SIZES[kind]
    env.simulation.view.userdata[:, entry] = start + SIZES[kind]


def _made(env: BatchEnvironment, kind: StepKind) -> np.ndarray:
    view = env.simulation.view
    if kind == "position":
        return (view.base_pos[:, 0] - START[0]) / SIZES[kind]
    return np.arctan2(view.base_mat[:, 3], view.base_mat[:, 0]) / SIZES[kind]
