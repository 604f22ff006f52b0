"""Stable-Baselines3 takes our worlds for its own: its wrappers, its evaluation, its learning."""

from __future__ import annotations

from collections.abc import Iterator

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecNormalize

from aerial_il.suite.faces.sb3_env import Sb3Env

ID = "aerial_il/hover-quad-v0"


@pytest.fixture
def env() -> Iterator[Sb3Env]:
    made = Sb3Env("quad", "hover", num_envs=3, max_episode_steps=5)
    yield made
    made.close()


def test_it_answers_as_its_own_dummy_of_single_environments(env: Sb3Env) -> None:
    dummy = DummyVecEnv([lambda: gymnasium.make(ID, max_episode_steps=5)] * 3)
    assert (env.observation_space, env.action_space) == (dummy.observation_space, dummy.action_space)
    env.seed(4), dummy.seed(4)
    mine, theirs = env.reset(), dummy.reset()
    assert isinstance(theirs, dict)
    rng = np.random.default_rng(0)
    for _ in range(5):
        for name in theirs:
            np.testing.assert_array_equal(mine[name], theirs[name], err_msg=name)
        actions = rng.uniform(env.action_space.low, env.action_space.high, (3, *env.action_space.shape))
        mine, reward, over, infos = env.step(actions)
        theirs, their_reward, their_over, their_infos = dummy.step(actions)
        np.testing.assert_array_equal(reward, their_reward)
        np.testing.assert_array_equal(over, their_over)
    assert over.all()
    for one, other in zip(infos, their_infos, strict=True):
        assert set(one) == set(other)
        assert one["TimeLimit.truncated"] == other["TimeLimit.truncated"]
        assert one["seed"] == other["seed"], "of the episode that ended"
        for name, value in other["terminal_observation"].items():
            np.testing.assert_array_equal(one["terminal_observation"][name], value, err_msg=name)


def test_its_wrappers_its_learner_and_its_evaluation_take_it(env: Sb3Env) -> None:
    model = PPO("MultiInputPolicy", VecNormalize(VecMonitor(env)), n_steps=4, batch_size=12, n_epochs=1, device="cpu")
    model.learn(24)
    rewards, lengths = evaluate_policy(model, VecMonitor(env), n_eval_episodes=3, return_episode_rewards=True)
    assert lengths == [5, 5, 5]
    assert np.isfinite(rewards).all()


def test_what_all_worlds_share_is_asked_once_for_each(env: Sb3Env) -> None:
    assert env.get_attr("num_envs") == [3, 3, 3]
    assert env.get_attr("render_mode", indices=[0]) == [None]
    assert env.env_is_wrapped(gymnasium.Wrapper) == [False] * 3
    assert list(env.get_images()) == [None] * 3
