"""Smoothness: what rough actions cost, and actors that are held back from them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from aerial_il import algorithms
from aerial_il.algorithms.dqn import DQN
from aerial_il.algorithms.online.collector import Collector, RewardScheme
from aerial_il.algorithms.online.smoothness import NO_SMOOTHNESS
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.categorical import Categorical
from aerial_il.policies.parts.layout import Layout
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from tests.algorithms.drift import SPEC, Drift
from tests.algorithms.made import made

POLICY = SquashedGaussian(hidden=(16,))
CHOICES = Categorical(hidden=(16,), choices="bounds")
SMALL: dict[str, Any] = {"warmup": 64, "batch_size": 32, "lr": 3e-3, "tau": 0.05, "critic_hidden": (16,)}
SMALL |= {"utd_ratio": 0.5, "actor_every": 1, "target_every": 1, "gamma": 0.9, "epochs": 4, "rollout": 80}
SMALL |= {"log_every": 80, "checkpoint_every": 0}


def short(name: str, **changes: Any) -> Any:
    cls: Any = algorithms.get(name)
    return made(cls, {**SMALL, **changes})


def train(settings: Any, run: Path, env: Any, **options: Any) -> Any:
    return settings.train(None, POLICY, env=env, run=run, seed=1, progress=False, **options)


def test_rough_actions_cost_what_the_settings_say() -> None:
    smoothness = replace(NO_SMOOTHNESS, rate_penalty=2.0, jerk_penalty=3.0)
    collector = Collector(Drift(1), Layout.of(SPEC, POLICY), seed=0, scheme=RewardScheme(smoothness=smoothness))
    actions = [-0.5, 1.0, 1.0, -0.5]  # from -1 to 1: -1, 1, 1, -1
    costs = [collector.step(np.array([[action]])).penalties[0] for action in actions]
    assert costs == pytest.approx([0.0, 2.0 * 4.0, 0.0, 2.0 * 4.0 + 3.0 * 0.0 + 3.0 * (-1.0 - 3.0 + 3.0 + 1.0) ** 2])
    collector.step(np.array([[1.0]]))
    assert collector.step(np.array([[-0.5]])).penalties[0] == pytest.approx(8.0 + 3.0 * (-1 - 3 * 1 + 3 * -1 - 1) ** 2)


def test_a_new_episode_owes_nothing_to_the_one_before() -> None:
    scheme = RewardScheme(smoothness=replace(NO_SMOOTHNESS, rate_penalty=1.0))
    collector = Collector(Drift(1), Layout.of(SPEC, POLICY), seed=0, scheme=scheme)
    while not collector.step(np.array([[1.0]])).terminal[0]:
        pass
    assert collector.step(np.array([[-0.5]])).penalties[0] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ppo", "sac", "td3", "ddpg"])
def test_caps_makes_actors_that_answer_alike_to_what_follows(tmp_path: Path, name: str) -> None:
    """Beside the same training without: the same seeds, the same flights at first."""
    steps = 4_000 if name == "ppo" else 800
    rough, smooth = (
        train(
            short(name, steps=steps, smoothness=replace(NO_SMOOTHNESS, temporal=w, spatial=w)),
            tmp_path / str(w),
            Drift(8),
        )
        for w in (0.0, 30.0)
    )
    assert roughness(smooth) < 0.5 * roughness(rough)


def roughness(policy: Any) -> float:
    env = Drift(64)
    obs, actions = env.reset(7), []
    policy.reset()
    for _ in range(5):
        actions.append(policy.act(obs))
        obs = env.step(actions[-1]).obs
    return float(np.abs(np.diff(actions, axis=0)).mean())


def test_an_actor_of_choices_cannot_be_regularised() -> None:
    network = CHOICES.build(2, 1)
    with pytest.raises(InvalidValueError, match=r"temporal is 1 .*rate_penalty"):
        replace(NO_SMOOTHNESS, temporal=1.0).loss(network, torch.zeros(3, 2), torch.zeros(3, 2))
    for asked in ("temporal", "spatial"):
        with pytest.raises(InvalidValueError, match=rf"{asked}( is)? 0\.5.*rate_penalty"):
            DQN(smoothness=replace(NO_SMOOTHNESS, **{asked: 0.5}))
    DQN(smoothness=replace(NO_SMOOTHNESS, rate_penalty=0.5))
