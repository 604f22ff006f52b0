"""Reinforcement and adversarial imitation learn in seconds what can be learned, and nothing from nothing."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aerial_il.algorithms.adversarial.reward_net import load_reward, reward_along
from aerial_il.algorithms.airl import AIRL
from aerial_il.algorithms.dac import DAC
from aerial_il.algorithms.gail import GAIL
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.core.errors import CheckpointError
from aerial_il.policies import load_policy
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from tests.algorithms.drift import Drift, Guide, demonstrations, mean_reward
from tests.algorithms.made import made
from tests.algorithms.stopped import assert_same_when_stopped
from tests.algorithms.test_resume import assert_same_end

POLICY = SquashedGaussian(hidden=(32, 32))
OFF: dict[str, Any] = {
    "warmup": 200,
    "utd_ratio": 0.5,
    "batch_size": 64,
    "lr": 2e-3,
    "critic_hidden": (32, 32),
    "gamma": 0.9,
    "tau": 0.05,
    "actor_every": 1,
}
JUDGE: dict[str, Any] = {"reward_hidden": (32,), "reward_lr": 2e-3, "reward_updates": 1.0, "gradient_penalty": 1.0}
ALONE: dict[str, Any] = {
    "bc_pretrain_steps": 0,
    "bc_weight": 0.0,
    "action_noise": False,
    "lr_floor": 1.0,
}  # the discriminator teaches
ON: dict[str, Any] = {
    "rollout": 512,
    "lr": 3e-3,
    "gamma": 0.9,
    "critic_hidden": (32, 32),
    "batch_size": 128,
    "epochs": 8,
}


def learn(settings: Any, run: Path, demos: list[Any] | None = None, *, ends: bool = False) -> float:
    policy = settings.train(demos, POLICY, env=Drift(8, ends_at_success=ends), run=run, seed=0, progress=False)
    assert load_policy(run).config == POLICY
    return mean_reward(policy) / mean_reward(Guide())


@pytest.mark.slow
def test_dac_imitates_by_demonstrations_without_a_reward(tmp_path: Path) -> None:
    settings = made(DAC, {**JUDGE, **OFF, **ALONE, "steps": 2_500})
    demos = demonstrations(10)
    assert learn(settings, tmp_path / "dac", demos) > 0.9
    assert learn(made(DAC, {"control": "random_actions"}, settings), tmp_path / "control", demos) < 0.85


@pytest.mark.slow
@pytest.mark.parametrize("reward", ["gail", "airl"])
def test_dac_learns_to_finish_early(tmp_path: Path, reward: Any) -> None:
    """Arriving ends the episode; a reward that is positive everywhere must not make it linger."""
    judge = {"reward_hidden": (32,), "gradient_penalty": 1.0, "reward": reward}
    settings = made(DAC, {**OFF, **ALONE, **judge, "steps": 3_000, "log_every": 1_000})
    learn(settings, tmp_path / "dac", demonstrations(10, ends_at_success=True), ends=True)
    assert read_metrics(tmp_path / "dac")[-1]["episode/success"] > 0.8


def test_until_the_warm_up_is_over_the_clone_flies_as_it_is(tmp_path: Path) -> None:
    """And afterwards it does not: what reinforcement has added can be told from what cloning had reached."""
    few = {"steps": 1_024, "bc_pretrain_steps": 200, "warmup": 1_024, "reward_updates": 2, "reward_batch": 64}
    settings = made(GAIL, {**ON, **few})
    demos, centres = demonstrations(3), []
    for name, chosen in (
        ("short", replace(settings, steps=512)),
        ("long", settings),
        ("on", replace(settings, warmup=0)),
    ):
        policy = chosen.train(demos, POLICY, env=Drift(8), run=tmp_path / name, progress=False)
        centres.append(np.concatenate([p.detach().numpy().ravel() for p in policy.network.parameters()]))
    np.testing.assert_array_equal(centres[0], centres[1])
    assert not np.array_equal(centres[1], centres[2])


@pytest.mark.slow
def test_the_learned_reward_shows_where_the_demonstrator_was(tmp_path: Path) -> None:
    demos = demonstrations(10)
    settings = made(DAC, {**JUDGE, **OFF, **ALONE, "steps": 1_500})
    settings.train(demos, POLICY, env=Drift(8), run=tmp_path, progress=False)
    shown = reward_along(tmp_path, demos[0])
    assert shown.shape == (len(demos[0]),)
    off = [replace(demo, executed_actions=-demo.executed_actions) for demo in demos]  # the wrong way, where it moves
    first = [np.mean([reward_along(tmp_path, demo)[0] for demo in flown]) for flown in (demos, off)]
    assert first[0] > first[1] + 0.5
    reward, interface = load_reward(tmp_path)
    assert reward.after(np.zeros((2, interface.layout.size), np.float32)).shape == (2,)
    with pytest.raises(CheckpointError, match="no learned reward"):
        load_reward(tmp_path / "nowhere")


EVERY: dict[str, Any] = {"steps": 480, "log_every": 60, "evaluate_every": 100, "checkpoint_every": 40, "batch_size": 16}
EVERY |= {"critic_hidden": (8,), "reward_hidden": (8,), "dropout": 0.2, "spectral_norm": True}
CLONED = {"bc_pretrain_steps": 5, "action_noise": True}
ON_POLICY = {**EVERY, "rollout": 48, "epochs": 2, "reward_batch": 32, "buffer_size": 200}
OFF_POLICY = {**EVERY, **CLONED, "warmup": 60, "utd_ratio": 0.3, "buffer_size": 300, "lr_floor": 0.1}
STOPPED = {
    "dac": made(DAC, {**OFF_POLICY, "expert_share": 0.25, "bc_weight": 1.0}),
    "gail": made(GAIL, {**ON_POLICY, **CLONED, "warmup": 100}),
    "airl": made(AIRL, ON_POLICY),
}


@pytest.mark.parametrize("name", STOPPED)
def test_a_stopped_run_ends_with_the_same_bytes(tmp_path: Path, name: str) -> None:
    def train(run: Path, evaluate: Any) -> None:
        env, demos = Drift(3, ends_at_success=True), demonstrations(4, ends_at_success=True)
        options = {"run": run, "seed": 3, "progress": False, "evaluate": evaluate}
        STOPPED[name].train(demos, SquashedGaussian(hidden=(8,)), env=env, **options)

    assert_same_when_stopped(train, tmp_path, 300)
    assert_same_end(tmp_path / "run", tmp_path / "whole")
