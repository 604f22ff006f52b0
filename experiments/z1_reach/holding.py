"""Steadiness of a policy that holds a pose: how far it strays, how its action changes step by step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aerial_il.core.contracts import BatchEnv, Policy

OFFSET = "tool_to_target"


@dataclass(frozen=True)
class Holding:
    """What was seen while poses were held; means over flights.

    Attributes:
        change: mean distance between two actions of the arm, element by element, as a share of half its range.
        reversals_hz: how often an element of the action turns about, 1/s; half the control rate, 25 Hz, is a swing
            there and back, 50 reversals in a second.
        away_cm: 95 % of the time the tool is no further from the target.
    """

    change: float
    reversals_hz: float
    away_cm: float


def hold(env: BatchEnv, policy: Policy, seeds: np.ndarray, *, steps: int, watched: int) -> Holding:
    """Fly ``steps`` steps through success and look at the last ``watched`` of them.

    Args:
        env: worlds of as many as there are ``seeds``, which success does not end. policy: what acts.
    """
    obs, actions, away = env.reset(seeds), [], []
    policy.reset()
    for _ in range(steps):
        actions.append(policy.act(obs))
        obs = env.step(actions[-1]).obs
        away.append(np.linalg.norm(obs[OFFSET], axis=1))
    low, high = env.spec.action.low, env.spec.action.high
    arm = (2.0 * np.stack(actions[-watched:]) / (high - low))[..., :-1]  # the last element is the gripper's
    return held(arm, np.stack(away[-watched:]), env.spec.control_dt_s)


def held(arm: np.ndarray, away_m: np.ndarray, dt_s: float) -> Holding:
    """Return what actions (T, n, Da), two units between their bounds, and distances (T, n) amount to."""
    changes = np.diff(arm, axis=0)
    turned = changes[1:] * changes[:-1] < 0
    return Holding(
        change=round(float(np.abs(changes).mean()), 4),
        reversals_hz=round(float(turned.mean()) / dt_s, 1),
        away_cm=round(100.0 * float(np.quantile(away_m, 0.95)), 2),
    )
