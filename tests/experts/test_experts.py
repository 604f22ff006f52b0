"""Experts are closed loop: they retry, take over anywhere, and forget when reset."""

import numpy as np
import pytest

import aerial_il
from aerial_il.core.contracts import Policy, PrivilegedPolicy
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.experts import insert_peg
from aerial_il.experts.expert import UNDECIDED, Expert
from aerial_il.experts.pick_place import CARRY, LIFT
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.props import CUBE_HALF_M, TABLE_HEIGHT_M
from tests.contract.registered import batch, each_sample, fly_until_solved, single

PICK = ("ua_quad_arm4", "pick_place")


def attached(worlds: BatchEnvironment, first_seed: int = 40_000, **options: float) -> Expert:
    """An expert at the start of episodes ``first_seed``, ``first_seed + 1``, …"""
    expert = aerial_il.expert(worlds.spec.robot, worlds.spec.task, **options)
    expert.attach(worlds)
    worlds.reset(first_seed)
    expert.reset()
    return expert


def fly_until_carried(worlds: BatchEnvironment, expert: Expert) -> None:
    """Fly every world to where the cube is first carried, and let it wait there."""
    flying = np.ones(worlds.num_envs, bool)
    for _ in range(worlds.spec.max_steps):
        action = expert.act({})
        flying &= expert.phase < CARRY
        worlds.step(action, flying)
        if not flying.any():
            return
    raise AssertionError("no cube was ever carried")


@each_sample
def test_an_expert_is_a_policy_with_phases(robot: str, task: str) -> None:
    worlds = batch(robot, task)
    expert = attached(worlds)
    assert isinstance(expert, Policy)
    assert isinstance(expert, PrivilegedPolicy)
    assert (expert.phase == UNDECIDED).all()
    action = expert.act({})
    assert action.shape == (3, worlds.spec.action.size)
    np.testing.assert_array_equal(worlds.spec.action.clip(action), action)
    assert ((expert.phase >= 0) & (expert.phase < len(expert.phase_names))).all()
    expert.reset(np.array([True, False, False]))
    assert (expert.phase == UNDECIDED).tolist() == [True, False, False]


def test_it_acts_in_a_single_environment_as_in_a_batch() -> None:
    worlds, env = batch(*PICK), single(*PICK)
    ours, alone = attached(worlds, 40_000), aerial_il.expert(*PICK)
    alone.attach(env)
    env.reset(seed=40_001)
    for _ in range(30):
        action = ours.act({})
        np.testing.assert_array_equal(alone.act({})[0], action[1])
        worlds.step(action)
        env.step(action[1])


def test_it_picks_the_cube_up_again_when_it_is_taken_away() -> None:
    worlds = batch(*PICK)
    expert = attached(worlds)
    fly_until_carried(worlds, expert)
    pose, speed = worlds.simulation.view.free_joint("cube")
    states = worlds.get_state()
    worlds.simulation.view.qpos[:, pose] = [0.1, 0.3, TABLE_HEIGHT_M + CUBE_HALF_M, 1.0, 0.0, 0.0, 0.0]
    worlds.simulation.view.qvel[:, speed] = 0.0
    worlds.set_state(worlds.get_state())
    for _ in range(20):
        worlds.step(expert.act({}))
    assert (expert.phase < LIFT).all(), "it noticed"
    assert not np.array_equal(states, worlds.get_state())
    assert fly_until_solved(worlds, expert).all()


def test_another_expert_takes_over_in_mid_flight() -> None:
    worlds = batch(*PICK)
    fly_until_carried(worlds, attached(worlds))
    second = aerial_il.expert(*PICK)
    second.attach(worlds)
    second.act({})
    assert (second.phase >= LIFT).all(), "the cube is in the gripper already"
    assert fly_until_solved(worlds, second).all()


def test_noise_is_seeded_by_episode_and_recovered_from() -> None:
    worlds = batch(*PICK)

    def commands(**options: float) -> np.ndarray:
        expert = attached(worlds, **options)
        actions = []
        for _ in range(40):
            actions.append(expert.act({}))
            worlds.step(actions[-1])
        return np.array(actions)

    plain, noisy = commands(), commands(noise=1.0, seed=1)
    np.testing.assert_array_equal(noisy, commands(noise=1.0, seed=1))
    assert not np.array_equal(noisy, commands(noise=1.0, seed=2))
    assert 0.005 < np.std(noisy[..., :3] - plain[..., :3]) < 0.1
    assert fly_until_solved(worlds, attached(worlds, noise=0.3)).all()


def test_a_noisy_expert_still_meets_the_peg() -> None:
    """Noise wider than what the fingers forgive makes demonstrations of retries, which nobody can imitate."""
    worlds = aerial_il.load_batch("big_four_z1", "insert_peg", num_envs=32, num_threads=1)
    expert = attached(worlds, noise=0.3)
    lifted, descents = np.zeros(worlds.num_envs, bool), np.zeros(worlds.num_envs, int)
    before = expert.phase.copy()
    for _ in range(400):
        worlds.step(expert.act({}), ~lifted)
        descents += ~lifted & (expert.phase == insert_peg.DESCEND) & (before != insert_peg.DESCEND)
        lifted |= expert.phase == insert_peg.CARRY
        before = expert.phase.copy()
    worlds.close()
    assert lifted.all()
    assert descents.mean() <= 2.0  # 1.3; 2.6 with all of the noise on the way down


def test_wrong_uses_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="not attached to an environment"):
        aerial_il.expert(*PICK).act({})
    with pytest.raises(InvalidValueError, match="Experts act at level 'ee_pose', the environment takes 'rotor'"):
        aerial_il.expert(*PICK).attach(single(*PICK, "calm", "rotor"))
    with pytest.raises(InvalidValueError, match="noise lies between 0 and 1, got 2"):
        aerial_il.expert(*PICK, noise=2.0)
    with pytest.raises(UnknownNameError, match="Did you mean 'reach'"):
        aerial_il.expert("ua_quad_arm4", "reech")
