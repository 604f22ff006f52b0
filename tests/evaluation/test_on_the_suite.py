"""Evaluation on the real suite: experts, gusts, films, and baselines that solve nothing."""

from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il.core.contracts import attach
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.latency import Latency
from aerial_il.evaluation.baselines import BASELINES
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.rollouts import evaluate, rollouts
from aerial_il.presentation.films import video
from aerial_il.suite.late import late

CELLS = (("fa_hexa_arm4", "pick_place"), ("ua_quad_arm4", "reach"))


def fly(robot: str, task: str, *, num_envs: int, episodes: int, tier: str = "gusts") -> EvaluationResult:
    env = aerial_il.load_batch(robot, task, num_envs=num_envs, tier=tier)
    try:
        expert = aerial_il.expert(robot, task)
        return evaluate(env, expert, range(500, 500 + episodes), policy_name="expert", progress=False)
    finally:
        env.close()


@pytest.mark.parametrize(("robot", "task"), CELLS)
def test_an_expert_is_judged_alike_on_any_number_of_worlds(robot: str, task: str) -> None:
    one, many = (fly(robot, task, num_envs=n, episodes=3) for n in (1, 4))
    assert one.episodes == many.episodes
    for episode in many.episodes:
        assert list(episode.subtasks) == list(many.metrics["subtasks"])
        assert episode.ee_error_mean_m is not None
        assert len(many.flights[episode.seed].ee_path) > 10


@pytest.mark.render
def test_a_flight_is_filmed_as_it_was_judged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(video, "VIEW_SIZE", (60, 80))
    robot, task = CELLS[1]  # the shorter flight
    result = fly(robot, task, num_envs=2, episodes=2)
    env = aerial_il.load_batch(robot, task, num_envs=1, tier="gusts")
    seed = result.seeds[1]  # flown in world 1, flown again in world 0
    actions = result.flights[seed].actions
    assert actions is not None
    won = [bool(step.info["success"][0]) for step in video.fly_again(env, seed, actions)]
    assert won == [False] * (len(actions) - 1) + [True]
    (clip,) = video.film(env, result, tmp_path, successes=1, failures=0).clips
    env.close()
    assert clip.episode.success
    assert 2_000 < clip.path.stat().st_size < 1_000_000


@pytest.mark.parametrize("name", BASELINES)
def test_an_episode_does_not_depend_on_those_beside_it(name: str) -> None:
    flown = {}
    for worlds in (1, 3):
        env = aerial_il.load_batch("ua_quad_arm4", "reach", num_envs=worlds, num_threads=1)
        for trace in rollouts(env, BASELINES[name](), [5, 6]):
            flown.setdefault(trace.seed, []).append(trace)
        env.close()
    for first, second in flown.values():
        np.testing.assert_array_equal(first.actions, second.actions)
        assert not first.success


@pytest.mark.parametrize("level", ["ee_pose", "base_joint", "velocity"])
def test_hovering_stays_where_it_began(level: str) -> None:
    env = aerial_il.load_batch("ua_quad_arm4", "reach", num_envs=2, action=level, num_threads=1)
    policy = attach(BASELINES["hover"](), env)
    obs = env.reset(3)
    policy.reset()
    start = obs["base_pos"].copy()
    for _ in range(100):
        obs = env.step(policy.act(obs)).obs
    assert np.abs(obs["base_pos"] - start).max() < 0.15
    env.close()


def test_hovering_bears_latency() -> None:
    env = late(aerial_il.load_batch("ua_quad_arm4", "reach", num_envs=2, num_threads=1), Latency(action_delay_ms=40))
    policy = attach(BASELINES["hover"](), env)
    obs = env.reset(3)
    policy.reset()
    assert np.isfinite(env.step(policy.act(obs)).obs["base_pos"]).all()
    env.close()


@pytest.mark.parametrize("name", BASELINES)
def test_a_baseline_asks_to_be_attached(name: str) -> None:
    with pytest.raises(InvalidValueError, match="attach"):
        BASELINES[name]().act({})
