"""Physics steps of half the length, controlled at the same rate, lead the same actions to the same place."""

from __future__ import annotations

import numpy as np
import pytest

import aerial_il
from aerial_il.core.arrays import length
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.scenario import Scenario

LIMIT_M = 0.01
SEEDS = np.arange(20_000, 20_016)
Flown = list[tuple[np.ndarray, np.ndarray, np.ndarray]]  # of each step: actions, who flew, tool positions


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["fa_hexa_arm4", "big_four_z1"])
def test_the_tool_goes_the_same_way_in_halved_steps(robot: str) -> None:
    scenario = Scenario(robot, "inspect_contact", "gusts")
    apart = _apart(scenario, _flown_by_expert(scenario), refinement=2)
    assert apart.max() <= LIMIT_M, f"largest distance of each flight, mm: {np.round(1e3 * apart, 1)}"


def test_a_refined_world_has_the_same_clock_and_another_last_bit() -> None:
    scenario = Scenario("fa_hexa_arm4", "inspect_contact", "gusts")
    coarse, fine = (BatchEnvironment(scenario, 1, refinement=parts) for parts in (1, 4))
    for env in (coarse, fine):
        env.reset(0)
        view = env.simulation.view
        hold = np.concatenate(
            [view.tool_pos, view.tool_mat[:, [0, 3, 6]], view.tool_mat[:, [1, 4, 7]], [[0.0]]], axis=1
        )
        for _ in range(10):
            env.step(hold)
    np.testing.assert_array_equal(fine.sim_time, coarse.sim_time)
    apart = length(fine.simulation.view.tool_pos - coarse.simulation.view.tool_pos)
    assert 0.0 < apart[0] < LIMIT_M


def _flown_by_expert(scenario: Scenario) -> Flown:
    env = BatchEnvironment(scenario, len(SEEDS))
    expert = aerial_il.expert(scenario.robot.name, scenario.task.name)
    env.reset(SEEDS)
    expert.attach(env)
    flying, flown = np.ones(len(SEEDS), bool), []
    while flying.any():
        action = expert.act({})
        result = env.step(action, flying)
        flown.append((action, flying, env.simulation.view.tool_pos.copy()))
        flying = flying & ~(result.info["success"] | result.terminated | result.truncated)
    return flown


def _apart(scenario: Scenario, flown: Flown, *, refinement: int) -> np.ndarray:
    """(n,) largest distance of each flight's tool from where it was, m, when its actions are flown again."""
    env = BatchEnvironment(scenario, len(SEEDS), refinement=refinement)
    env.reset(SEEDS)
    apart = np.zeros(len(SEEDS))
    for action, flying, tool in flown:
        env.step(action, flying)
        apart = np.maximum(apart, np.where(flying, length(env.simulation.view.tool_pos - tool), 0.0))
    return apart
