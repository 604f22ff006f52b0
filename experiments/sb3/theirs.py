"""Stable-Baselines3 on the tasks that ours learns, judged on as many episodes: its curve, its returns, its time."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from importlib import metadata
from typing import Any

from aerial_il.core.seeding import torch_threads

PACKAGE = "stable-baselines3"
INSTALLED = importlib.util.find_spec("stable_baselines3") is not None


@dataclass(frozen=True)
class Theirs:
    """What it is asked for.

    Attributes:
        algorithm: name of its class. settings: its keyword arguments, but for the network; ``lin_X`` is X falling
            linearly to zero, ``noise`` the deviation of Ornstein-Uhlenbeck noise, as its authors' collection has them.
        network: ``policy_kwargs`` as JSON values; ``activation`` is ``relu`` or ``tanh``.
        normalised: whether observations and rewards are.
        processes: whether each world has a process of its own.
    """

    algorithm: str
    settings: Mapping[str, Any]
    network: Mapping[str, Any]
    normalised: bool = False
    processes: bool = False

    def decided_by(self) -> dict[str, Any]:
        """Return all that decides a training, besides task, worlds, steps and seed."""
        return {**asdict(self), PACKAGE: metadata.version(PACKAGE)}


@dataclass(frozen=True)
class Found:
    """What came of it.

    Attributes:
        returns: of the episodes that judge the final policy. seconds: of the training.
        curve: (steps, seconds, mean return of the last hundred episodes) along it.
    """

    returns: list[float]
    seconds: float
    curve: list[tuple[float, float, float]]


def learn(
    theirs: Theirs, make: Callable[[], Any], *, steps: int, worlds: int, seed: int, episodes: int, judge_seed: int
) -> Found:
    """Train and judge one policy; its final one, its mean action.

    Args:
        make: makes a world. steps: of all worlds together. worlds: flown at once. seed: of all its chance.
        episodes: that judge it, in a world of their own from the seed ``judge_seed`` on.
    """
    import stable_baselines3
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.evaluation import evaluate_policy
    from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecNormalize
    from torch import nn

    vector = SubprocVecEnv if theirs.processes else DummyVecEnv
    options = {"start_method": "spawn"} if theirs.processes else None
    env: Any = make_vec_env(make, n_envs=worlds, seed=seed, vec_env_cls=vector, vec_env_kwargs=options)
    if theirs.normalised:
        env = VecNormalize(env, gamma=theirs.settings.get("gamma", 0.99))
    network = dict(theirs.network)
    if "activation" in network:
        network["activation_fn"] = {"relu": nn.ReLU, "tanh": nn.Tanh}[network.pop("activation")]
    asked = keywords(theirs.settings, env.action_space)
    with torch_threads(1):
        learner = getattr(stable_baselines3, theirs.algorithm)(
            "MultiInputPolicy" if hasattr(env.observation_space, "spaces") else "MlpPolicy",
            env, seed=seed, policy_kwargs=network, device="cpu", **asked,
        )  # fmt: skip
        watched = Watch()
        started = time.perf_counter()
        learner.learn(steps, callback=watched.callback(started))
        seconds = time.perf_counter() - started
        judging: Any = make_vec_env(make, n_envs=1, seed=judge_seed)
        if theirs.normalised:
            judging = VecNormalize(judging, training=False, norm_reward=False)
            judging.obs_rms = env.obs_rms
        judged: Any = evaluate_policy(learner, judging, n_eval_episodes=episodes, return_episode_rewards=True)
    judging.close()
    env.close()
    return Found([float(value) for value in judged[0]], seconds, watched.curve)


def keywords(settings: Mapping[str, Any], actions: Any) -> dict[str, Any]:
    """Return settings as it takes them, for an environment with that space of ``actions``."""
    found = {name: schedule(value) for name, value in settings.items()}
    if "noise" in found:
        import numpy as np
        from stable_baselines3.common.noise import OrnsteinUhlenbeckActionNoise

        deviation = np.full(actions.shape, found.pop("noise"))
        found["action_noise"] = OrnsteinUhlenbeckActionNoise(np.zeros(actions.shape), deviation)
    return found


def schedule(value: Any) -> Any:
    """Return a setting as it takes it: of ``lin_X`` a function of the share of the training that is left."""
    if isinstance(value, str) and value.startswith("lin_"):
        first = float(value.removeprefix("lin_"))
        return lambda left: first * left
    return value


class Watch:
    """Notes its curve at the ends of its rollouts, ``every`` environment steps at the earliest."""

    def __init__(self, every: int = 1000) -> None:
        self.curve: list[tuple[float, float, float]] = []
        self._every = every

    def callback(self, started: float) -> Any:
        """Return what it calls as it goes on; times count from ``started``."""
        from stable_baselines3.common.callbacks import BaseCallback

        watch = self

        class Noting(BaseCallback):
            def _on_step(self) -> bool:
                return True

            def _on_rollout_end(self) -> None:
                watch.note(self.num_timesteps, time.perf_counter() - started, self.model.ep_info_buffer)

        return Noting()

    def note(self, steps: int, seconds: float, ended: Any) -> None:
        """Take in the returns of the episodes that ended last."""
        if ended and steps - (self.curve[-1][0] if self.curve else 0) >= self._every:
            mean = sum(episode["r"] for episode in ended) / len(ended)
            self.curve.append((float(steps), seconds, float(mean)))
