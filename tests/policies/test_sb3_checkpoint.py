"""What Stable-Baselines3 saved is flown as it would fly it, without unpickling anything."""

import io
import json
import pickle
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch

pytest.importorskip("stable_baselines3")

from stable_baselines3 import A2C, DQN, PPO, SAC, TD3
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

import aerial_il
from aerial_il.cli.main import main
from aerial_il.core.errors import CheckpointError, InvalidValueError
from aerial_il.policies.parts.sb3_checkpoint import Sb3Policy
from aerial_il.suite.faces.sb3_env import Sb3Env

SMALL: dict[str, Any] = {"net_arch": [8, 8]}


@pytest.fixture(scope="module")
def pendulum() -> Iterator[Any]:
    env = aerial_il.load_gymnasium("Pendulum-v1", num_envs=3, max_steps=5, success="survived")
    yield env
    env.close()


@pytest.mark.parametrize("learner", [PPO, A2C, SAC, TD3])
@pytest.mark.parametrize("activation", [None, torch.nn.ELU])
def test_a_vector_is_answered_as_its_own_predict_does(
    learner: Any, activation: Any, pendulum: Any, tmp_path: Path
) -> None:
    settings = SMALL | ({"activation_fn": activation} if activation else {})
    model = learner("MlpPolicy", "Pendulum-v1", policy_kwargs=settings, device="cpu", seed=3)
    model.save(tmp_path / "model")
    policy = Sb3Policy(tmp_path / "model.zip")
    policy.attach(pendulum)
    obs = pendulum.reset(0)
    wanted = model.predict(obs["observation"].astype(np.float32), deterministic=True)[0]
    np.testing.assert_allclose(policy.act(obs), wanted, rtol=1e-5, atol=1e-6)


def test_a_dictionary_is_answered_as_its_own_predict_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    theirs = Sb3Env("quad", "hover", num_envs=2)
    model = PPO("MultiInputPolicy", theirs, n_steps=2, batch_size=4, policy_kwargs=SMALL, device="cpu")
    model.save(tmp_path / "model")
    policy = Sb3Policy(tmp_path / "model.zip")
    env = aerial_il.load_batch("quad", "hover", num_envs=2)
    policy.attach(env)
    obs = env.reset(4)
    np.testing.assert_allclose(policy.act(obs), model.predict(obs, deterministic=True)[0], rtol=1e-4, atol=1e-6)
    env.close(), theirs.close()
    monkeypatch.chdir(tmp_path)
    words = ["policy=model.zip", "robot=quad", "task=hover", "episodes=2", "videos=0", "progress=false", "out=judged"]
    assert main(["evaluate", *words]) == 0


@pytest.mark.parametrize("learner", [PPO, A2C])
def test_the_highest_score_is_chosen_however_large_scores_are(learner: Any, tmp_path: Path) -> None:
    """Clipped to the bounds of the scores, from 0 to 1, they would all be the same."""
    model = learner("MlpPolicy", "CartPole-v1", policy_kwargs=SMALL, device="cpu", seed=3)
    with torch.no_grad():
        model.policy.action_net.weight.mul_(1e4)
        model.policy.action_net.bias.copy_(torch.tensor([20.0, 20.0]))
    model.save(tmp_path / "model")
    env = aerial_il.load_gymnasium("CartPole-v1", num_envs=32)
    policy = Sb3Policy(tmp_path / "model.zip")
    policy.attach(env)
    obs = env.reset(0)
    seen = obs["observation"].astype(np.float32)
    scores = model.policy.get_distribution(torch.from_numpy(seen)).distribution.logits
    wanted = model.predict(seen, deterministic=True)[0]
    assert set(wanted) == {0, 1}, "a check in which one is always chosen would tell little"
    assert scores.abs().max() > 1.0
    np.testing.assert_array_equal(policy.act(obs), np.eye(2)[wanted])
    env.close()


def test_a_choice_among_numbers_and_other_spaces_are_refused(tmp_path: Path) -> None:
    PPO("MlpPolicy", "CartPole-v1", policy_kwargs=dict(SMALL), device="cpu").save(tmp_path / "model")
    env = aerial_il.load_gymnasium("CartPole-v1")
    action = replace(env.spec.action, low=np.full(2, -3.0), high=np.full(2, 3.0))
    env.spec = replace(env.spec, action=action)
    with pytest.raises(InvalidValueError, match=r"chooses one of 2 actions; gymnasium/CartPole-v1 takes numbers.*env="):
        Sb3Policy(tmp_path / "model.zip").attach(env)
    several = gymnasium.make("CartPole-v1")
    several.action_space = gymnasium.spaces.MultiDiscrete([2, 2])
    PPO("MlpPolicy", several, policy_kwargs=SMALL, device="cpu").save(tmp_path / "several")
    with pytest.raises(CheckpointError, match=r"MultiDiscrete.*Box and Discrete.*MODULE:FACTORY"):
        Sb3Policy(tmp_path / "several.zip")


def test_another_environment_is_refused(pendulum: Any, tmp_path: Path) -> None:
    model = PPO("MlpPolicy", "MountainCarContinuous-v0", policy_kwargs=SMALL, device="cpu")
    model.save(tmp_path / "model")
    with pytest.raises(InvalidValueError, match="maps 2 numbers to 1; gymnasium/Pendulum-v1 shows 3 and takes 1"):
        Sb3Policy(tmp_path / "model.zip").attach(pendulum)


def test_another_kind_of_network_is_refused(tmp_path: Path) -> None:
    DQN("MlpPolicy", "CartPole-v1", policy_kwargs=dict(SMALL), device="cpu").save(tmp_path / "model")
    with pytest.raises(CheckpointError, match="no perceptron of PPO"):
        Sb3Policy(tmp_path / "model.zip")


class _Touch:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.path,)


def test_nothing_of_the_file_is_run(tmp_path: Path) -> None:
    canary = tmp_path / "canary"
    hostile = pickle.dumps(_Touch(canary))
    pickle.loads(hostile)
    assert canary.exists(), "it would succeed on a careless reader"
    canary.unlink()
    raw = io.BytesIO()
    torch.save(_Touch(canary), raw)
    for weights in (raw.getvalue(), hostile, b"", b"PK"):
        with zipfile.ZipFile(tmp_path / "model.zip", "w") as archive:
            archive.writestr("data", json.dumps({"policy_class": {":serialized:": hostile.hex()}}))
            archive.writestr("policy.pth", weights)
        with pytest.raises(CheckpointError):
            Sb3Policy(tmp_path / "model.zip")
        assert not canary.exists()
    (tmp_path / "model.zip").write_bytes(b"no zip")
    with pytest.raises(CheckpointError):
        Sb3Policy(tmp_path / "model.zip")


def test_a_flattened_dictionary_is_seen_in_its_own_order(tmp_path: Path) -> None:
    flat = gymnasium.wrappers.FlattenObservation(gymnasium.make("aerial_il/hover-quad-v0"))
    model = PPO("MlpPolicy", flat, policy_kwargs=SMALL, device="cpu", seed=3)
    model.save(tmp_path / "model")
    seen, _ = flat.reset(seed=4)
    env = aerial_il.load_batch("quad", "hover", num_envs=1)
    policy = Sb3Policy(tmp_path / "model.zip")
    policy.attach(env)
    wanted = model.predict(seen, deterministic=True)[0]
    np.testing.assert_allclose(policy.act(env.reset(4))[0], wanted, rtol=1e-4, atol=1e-5)
    env.close(), flat.close()


class _Learned(BaseFeaturesExtractor):
    def __init__(self, space: Any) -> None:
        super().__init__(space, 3)
        self.linear = torch.nn.Linear(3, 3)

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        return self.linear(observations)


@pytest.mark.parametrize(
    ("learner", "changed", "says"),
    [
        (PPO, {"policy_kwargs": SMALL | {"features_extractor_class": _Learned}}, "a features extractor"),
        (PPO, {"policy_kwargs": SMALL | {"squash_output": True}, "use_sde": True}, "squash_output"),
        (SAC, {"policy_kwargs": SMALL | {}, "use_sde": True}, "use_sde"),
    ],
)
def test_what_acts_through_more_than_a_perceptron_is_refused(
    learner: Any, changed: dict[str, Any], says: str, tmp_path: Path
) -> None:
    learner("MlpPolicy", "Pendulum-v1", device="cpu", **changed).save(tmp_path / "model")
    with pytest.raises(CheckpointError, match=f"{says}.*MODULE:FACTORY"):
        Sb3Policy(tmp_path / "model.zip")


def test_actions_that_had_other_limits_are_refused(pendulum: Any, tmp_path: Path) -> None:
    narrow = gymnasium.wrappers.RescaleAction(gymnasium.make("Pendulum-v1"), -1.0, 1.0)
    PPO("MlpPolicy", narrow, policy_kwargs=dict(SMALL), device="cpu").save(tmp_path / "model")
    with pytest.raises(InvalidValueError, match=r"actions from \[-1\.\] to \[1\.\].*from \[-2\.\] to \[2\.\]"):
        Sb3Policy(tmp_path / "model.zip").attach(pendulum)
    SAC("MlpPolicy", narrow, policy_kwargs=dict(SMALL), device="cpu").save(tmp_path / "model")
    Sb3Policy(tmp_path / "model.zip").attach(pendulum)  # its answers are stretched to the limits, as they were there
