"""The same seed and the same actions give the same bytes: alone, in a batch of any size, on any threads, resumed."""

from __future__ import annotations

import dm_env
import mujoco
import numpy as np
import pytest

import aerial_il
from aerial_il.suite.batch import BatchEnvironment, StepResult
from aerial_il.suite.episode.simulation import STATE_OFFSET
from aerial_il.suite.physics import episode_state
from tests.contract.registered import (
    CELLS,
    batch,
    each_cell_and_level,
    each_sample,
    hold_actions,
    random_actions,
    single,
)

SEEDS = np.array([11, 5, 2**53 - 1])


def assert_same_step(timestep: dm_env.TimeStep, info: dict[str, np.ndarray], result: StepResult, world: int) -> None:
    """What the single environment answers equals, bit for bit, what one world of the batch answers."""
    for name, value in timestep.observation.items():
        np.testing.assert_array_equal(value, result.obs[name][world], err_msg=name)
    for name, value in info.items():
        np.testing.assert_array_equal(value, result.info[name][world], err_msg=name)
    assert timestep.reward == result.reward[world]
    assert (info["crash"] | info["dropped"]) == result.terminated[world]


@each_cell_and_level
def test_a_world_of_a_batch_is_the_single_environment(robot: str, task: str, level: str) -> None:
    env, worlds = single(robot, task, "hard", level), batch(robot, task, "hard", level)
    obs, first = worlds.reset(SEEDS), env.reset(seed=int(SEEDS[1]))
    for name, value in first.observation.items():
        np.testing.assert_array_equal(value, obs[name][1], err_msg=name)
    for actions in random_actions(worlds.spec.action, 100, 3):
        result, timestep = worlds.step(actions), env.step(actions[1])
        assert_same_step(timestep, env.info, result, 1)
        np.testing.assert_array_equal(env.get_state()[0], worlds.get_state()[1])
        if timestep.last():
            break


@pytest.mark.parametrize(("num_envs", "threads"), [(1, 1), (3, 2), (40, 1), (40, 2)])
@pytest.mark.parametrize("tier", ["calm", "hard"])
def test_a_world_does_not_depend_on_how_many_there_are(tier: str, num_envs: int, threads: int) -> None:
    robot, task = CELLS[-1]
    worlds = aerial_il.load_batch(robot, task, num_envs=num_envs, tier=tier, num_threads=threads, seed=4)
    alone = single(robot, task, tier)
    alone.reset(seed=4 + num_envs - 1)
    for actions in random_actions(worlds.spec.action, 25, num_envs):
        seen, timestep = worlds.step(actions).obs, alone.step(actions[-1])
        for name, value in timestep.observation.items():
            np.testing.assert_array_equal(value, seen[name][-1], err_msg=name)
    np.testing.assert_array_equal(worlds.get_state()[-1], alone.get_state()[0])
    worlds.close()


@each_sample
def test_actions_laid_out_by_columns_are_the_same_actions(robot: str, task: str) -> None:
    worlds, answers = batch(robot, task), []
    actions = random_actions(worlds.spec.action, 20, 3)
    for order in ("C", "F"):
        worlds.reset(SEEDS)
        answers.append([worlds.step(np.asarray(each, order=order)) for each in actions])
    for by_rows, by_columns in zip(*answers, strict=True):
        for name, value in by_rows.info.items():
            np.testing.assert_array_equal(value, by_columns.info[name], err_msg=name)
        np.testing.assert_array_equal(by_rows.reward, by_columns.reward)


@each_sample
def test_same_seed_same_trajectory_and_another_seed_another(robot: str, task: str) -> None:
    worlds = batch(robot, task, "hard")
    actions = random_actions(worlds.spec.action, 20, 3)
    ends = []
    for seeds in (SEEDS, SEEDS, SEEDS[::-1]):
        worlds.reset(seeds)
        for action in actions:
            worlds.step(action)
        ends.append(worlds.get_state())
    np.testing.assert_array_equal(ends[0], ends[1])
    assert not np.array_equal(ends[0][0], ends[2][0])


def fly(worlds: BatchEnvironment, actions: np.ndarray) -> list[np.ndarray]:
    """States, and observations behind them, after each of the actions (steps, n, Da)."""
    states = []
    for action in actions:
        obs = worlds.step(action).obs
        seen = [obs[name].reshape(worlds.num_envs, -1) for name in worlds.spec.observation.state_names]
        states.append(np.column_stack([worlds.get_state(), *seen]))
    return states


@each_cell_and_level
def test_any_step_can_be_resumed_bit_for_bit(robot: str, task: str, level: str) -> None:
    worlds = batch(robot, task, "hard", level)
    worlds.reset(SEEDS)
    actions = random_actions(worlds.spec.action, 24, 3)
    fly(worlds, actions[:9])
    middle, seen = worlds.get_state(), worlds.observe()
    onwards = fly(worlds, actions[9:])

    worlds.reset(0)  # forget
    again = worlds.set_state(middle)
    for name, value in seen.items():
        np.testing.assert_array_equal(value, again[name], err_msg=name)
    for here, there in zip(fly(worlds, actions[9:]), onwards, strict=True):
        np.testing.assert_array_equal(here, there)


@each_sample
def test_a_state_moves_between_worlds_batch_and_single(robot: str, task: str) -> None:
    worlds, env = batch(robot, task, "hard"), single(robot, task, "hard")
    worlds.reset(SEEDS)
    actions = random_actions(worlds.spec.action, 16, 3)
    fly(worlds, actions[:8])
    middle = worlds.get_state()
    end = fly(worlds, actions[8:])[-1]

    env.reset(seed=0)
    env.set_state(middle[1:2])
    for action in actions[8:12]:
        env.step(action[1])
    worlds.reset(0)
    worlds.set_state(np.repeat(env.get_state(), 3, axis=0), mask=np.array([True, False, False]))
    again = fly(worlds, np.repeat(actions[12:, 1:2], 3, axis=1))[-1]
    np.testing.assert_array_equal(again[0], end[1])
    assert worlds.simulation.seeds[0] == SEEDS[1]


@each_sample
def test_worlds_outside_the_mask_stand_still(robot: str, task: str) -> None:
    worlds = batch(robot, task, "hard")
    worlds.reset(SEEDS)
    actions = random_actions(worlds.spec.action, 12, 3)
    straight = fly(worlds, actions)[-1]
    worlds.reset(SEEDS)
    before = worlds.get_state()
    only = np.array([False, True, False])
    actions[:, ~only] = np.nan  # nobody looks at them
    for action in actions:
        worlds.step(action, only)
    np.testing.assert_array_equal(worlds.get_state()[~only], before[~only])
    np.testing.assert_array_equal(worlds.get_state()[only], straight[only, : worlds.spec.state_size])


def test_the_single_environment_counts_on_from_a_restored_step() -> None:
    robot, task = CELLS[0]
    env, worlds = single(robot, task), batch(robot, task)
    worlds.reset(7)
    late = worlds.get_state()
    late[:, _index_of_step(worlds)] = worlds.spec.max_steps - 2
    hover = hold_actions(worlds)
    worlds.set_state(late)
    env.reset(seed=0)
    env.set_state(late[:1])
    for expected in (False, True):
        assert worlds.step(hover).truncated[0] == expected
        assert env.step(hover[0]).last() == expected


def _index_of_step(worlds: BatchEnvironment) -> int:
    """Where a state keeps the control step."""
    return mujoco.mj_stateSize(worlds.model, STATE_OFFSET) + episode_state.STEP
