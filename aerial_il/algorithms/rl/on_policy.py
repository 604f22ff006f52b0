"""On-policy learning: settings, and rollouts of all worlds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from aerial_il.algorithms.rl.algorithm import OnlineAlgorithm
from aerial_il.algorithms.rl.collector import Collector
from aerial_il.algorithms.rl.interface import decode, encode
from aerial_il.algorithms.run.checks import require_not_negative, require_positive, require_share, require_widths
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts.layout import Interface


@dataclass(frozen=True, kw_only=True)
class OnPolicy(OnlineAlgorithm):
    """Settings of runs that learn from one rollout at a time.

    Attributes:
        rollout: environment steps in a rollout, of all worlds together.
        epochs: passes over it. batch_size: transitions in a minibatch.
        lr: learning rate at the start; it falls linearly to zero.
        gae_lambda: lambda of the generalised advantages.
        clip: how far the ratio of probabilities counts.
        entropy: weight of the entropy. clip_norm: largest gradient norm.
        target_kl: where a rollout's updates of the actor stop; 0 for nowhere.
        critic_hidden: widths of the critic.
    """

    rollout: int = 2048
    epochs: int = 10
    batch_size: int = 64
    lr: float = 3e-4
    gae_lambda: float = 0.95
    clip: float = 0.2
    entropy: float = 0.0
    clip_norm: float = 0.5
    target_kl: float = 0.0
    critic_hidden: tuple[int, ...] = (64, 64)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "epochs", "lr", "clip", "clip_norm")
        require_not_negative(self, "entropy", "target_kl")
        for name in ("rollout", "batch_size"):
            if not getattr(self, name) >= 2:
                raise InvalidValueError(f"{name} is {getattr(self, name)}; advantages are compared, so at least 2.")
        require_share(self, "gae_lambda")
        require_widths(self, "critic_hidden")


class Rollout(NamedTuple):
    """T steps of n worlds.

    Attributes:
        frames: (T, n, Do) in the world. obs, next_obs: (T, n, Do) encoded; ``next_obs`` was seen before any reset.
        actions: (T, n, Da) normalised. raw: (T, n, Da) before the tanh. log_prob: (T, n) logarithm of their density.
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
    """Draws actions (n, Da), their forms before the tanh (n, Da) and log densities (n,) for observations (n, Do)."""

    def explore(self, obs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]: ...


def collect_rollout(collector: Collector, interface: Interface, actor: StochasticActor, steps: int) -> Rollout:
    """Take ``steps`` environment steps of all worlds together, or a few more, with actions drawn by ``actor``."""
    rows: list[tuple[np.ndarray, ...]] = []
    for _ in range(-(-steps // collector.n)):
        frames, obs = collector.frames, encode(interface, collector.frames)
        actions, raw, log_prob = actor.explore(obs)
        step = collector.step(decode(interface, actions, frames))
        after = encode(interface, step.next_frames)
        rows.append((frames, obs, after, actions, raw, log_prob, step.rewards, step.terminal, step.truncated))
    return Rollout(*(np.stack(values) for values in zip(*rows, strict=True)))
