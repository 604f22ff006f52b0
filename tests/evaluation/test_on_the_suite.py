"""Evaluation on the real suite: experts, gusts, films."""

from __future__ import annotations

from pathlib import Path

import pytest

import aerial_il
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.presentation.films import video

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
def test_a_flight_is_filmed_as_it_was_judged(tmp_path: Path) -> None:
    robot, task = CELLS[1]  # the shorter flight
    result = fly(robot, task, num_envs=2, episodes=2)
    env = aerial_il.load_batch(robot, task, num_envs=1, tier="gusts")
    seed = result.seeds[1]  # flown in world 1, flown again in world 0
    actions = result.flights[seed].actions
    assert actions is not None
    won = [bool(info["success"][0]) for info in video.fly_again(env, seed, actions)]
    assert won == [False] * (len(actions) - 1) + [True]
    (clip,) = video.film(env, result, tmp_path, successes=1, failures=0).clips
    env.close()
    assert clip.episode.success
    assert 20_000 < clip.path.stat().st_size < 1_000_000
