"""On-policy learning: settings, and rollouts of all worlds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from aerial_il.algorithms.online.collector import Collector
from aerial_il.algorithms.online.interface import decode, encode
from aerial_il.algorithms.online.problem import whole_turns
from aerial_il.algorithms.rl.algorithm import OnlineAlgorithm
from aerial_il.algorithms.run.checks import require_not_negative, require_positive, require_share, require_widths
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts.layout import Interface


@dataclass(frozen=True, kw_only=True)
class OnPolicy(OnlineAlgorithm):
    """Settings of runs that learn from one rollout at a time.

    Attributes:
        rollout: environment steps in a rollout, of all worlds together.
        lr: learning rate at the start; it falls linearly to zero.
        gae_lambda: lambda of generalised advantage estimation.
        critic_hidden: widths of the critic.
    """

    rollout: int = 2048
    lr: float = 3e-4
    gae_lambda: float = 0.95
    critic_hidden: tuple[int, ...] = (64, 64)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "lr")
        require_compared(self, "rollout")
        require_share(self, "gae_lambda")
        require_widths(self, "critic_hidden")

    def flown_before_learning(self, worlds: int) -> dict[str, int]:
        return {"rollout": whole_turns(self.rollout, worlds)}  # for the last rollout no learning rate is left


@dataclass(frozen=True, kw_only=True)
class ProximalOnPolicy(OnPolicy):
    """Settings of those that go over a rollout several times, the actor kept near the policy that acted.

    Attributes:
        epochs: passes over a rollout. batch_size: transitions in a minibatch.
        clip: how far from 1 the probability ratio counts.
        entropy: weight of the entropy. clip_norm: largest gradient norm.
        target_kl: a pass of a mean KL divergence above 1.5 times this is the actor's last; 0 for no limit.
    """

    epochs: int = 10
    batch_size: int = 64
    clip: float = 0.2
    entropy: float = 0.0
    clip_norm: float = 0.5
    target_kl: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "epochs", "clip", "clip_norm")
        require_not_negative(self, "entropy", "target_kl")
        require_compared(self, "batch_size")


def require_compared(settings: object, name: str) -> None:
    """Raise :class:`InvalidValueError` unless the named setting is at least two steps."""
    if not getattr(settings, name) >= 2:
        raise InvalidValueError(f"{name} is {getattr(settings, name)}; advantages are compared, so at least 2.")


class Rollout(NamedTuple):
    """T steps of n worlds.

    Attributes:
        frames: (T, n, Do) in the world. obs, next_obs: (T, n, Do) encoded; ``next_obs`` was seen before any reset.
        actions: (T, n, Da) normalised. raw: (T, n, R) the samples behind them: pre-tanh samples, or indices of
            discrete actions. log_prob: (T, n) their log density.
        rewards: (T, n) of the environment. terminal, truncated: (T, n) bool; see :class:`Transition`.
    """

    frames: np.ndarray
    obs: np.ndarray
    next_obs: np.ndarray
    actions: np.ndarray
    raw: np.ndarray
    log_prob: np.ndarray
    rewards: np.ndarray
    terminal: np.ndarray
    truncated: np.ndarray

    @property
    def ended(self) -> np.ndarray:
        """(T, n) bool, the step was the last of its episode."""
        return self.terminal | self.truncated

    def flat(self, name: str) -> np.ndarray:
        """Return one entry as (T * n, ...)."""
        values = getattr(self, name)
        return values.reshape(-1, *values.shape[2:])


class StochasticActor(Protocol):
    """Samples actions (n, Da), ``raw`` samples (n, R) and log densities (n,) for observations (n, Do)."""

    def explore(self, obs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]: ...


def collect_rollout(collector: Collector, interface: Interface, actor: StochasticActor, steps: int) -> Rollout:
    """Take ``steps`` environment steps of all worlds together, or a few more, with actions sampled from ``actor``."""
    rows: list[tuple[np.ndarray, ...]] = []
    for _ in range(-(-steps // collector.n)):
        frames, obs = collector.frames, encode(interface, collector.frames)
        actions, raw, log_prob = actor.explore(obs)
        step = collector.step(decode(interface, actions, frames))
        after = encode(interface, step.next_frames)
        rows.append((frames, obs, after, actions, raw, log_prob, step.rewards, step.terminal, step.truncated))
    return Rollout(*(np.stack(values) for values in zip(*rows, strict=True)))
