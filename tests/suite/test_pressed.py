"""The tool pressed into the table: the vehicle stays where it is, whoever sends it there."""

from __future__ import annotations

import numpy as np
import pytest

import aerial_il
from aerial_il.suite.props import TABLE_HEIGHT_M

DOWN, WORLDS, DEPTH_M = [0, 0, -1, 0, 1, 0], 4, 0.04  # the tool's first two axes; m below the table's surface
ABOVE_S, NEAR_S, PRESSED_S, FREED_S = 2.5, 1.5, 3.0, 1.5


def pressed(robot: str, tier: str) -> tuple[float, float, float]:
    """Return the most that the base is lifted, that the tool slides while pressed, and that it is off when freed, m."""
    env = aerial_il.load_batch(robot, "pick_place", tier=tier, num_envs=WORLDS)
    obs, dt = env.reset(900000), env.spec.control_dt_s
    action, place, seen = np.zeros((WORLDS, env.spec.action.size)), obs["ee_pos"][:, :2].copy(), []
    action[:, 3:9], action[:, :2] = DOWN, place
    for duration, height in ((ABOVE_S, 0.1), (NEAR_S, 0.03), (PRESSED_S, -DEPTH_M), (FREED_S, 0.15)):
        action[:, 2] = TABLE_HEIGHT_M + height
        for _ in range(round(duration / dt)):
            obs = env.step(action).obs
            seen.append(np.concatenate([obs["base_pos"][:, 2:], obs["ee_pos"][:, :2] - place], axis=1))
    env.close()
    flight = np.array(seen)
    first, last = round((ABOVE_S + NEAR_S) / dt), round((ABOVE_S + NEAR_S + PRESSED_S) / dt)
    lifted = flight[first:last, :, 0].max(axis=0) - flight[first - 1, :, 0]
    aside = np.linalg.norm(flight[..., 1:], axis=2)
    return float(lifted.max()), float(aside[first:last].max()), float(aside[last:].max())


@pytest.mark.parametrize(("tier", "share"), [("calm", 1.0), ("gusts", 2.0)])  # gusts move it by themselves
@pytest.mark.parametrize("robot", ["fa_hexa_arm4", "ua_quad_arm4", "big_four_z1"])
def test_a_tool_pressed_into_the_table_throws_nothing(robot: str, tier: str, share: float) -> None:
    lifted, aside, freed = pressed(robot, tier)
    assert lifted <= 0.03 * share
    assert aside <= 0.03 * share
    assert freed <= 0.05 * share
