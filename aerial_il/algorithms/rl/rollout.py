"""One on-policy rollout of n worlds: what was seen, done and paid, and what an update learns from it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aerial_il.algorithms.rl.collector import EndlessFlight
from aerial_il.algorithms.rl.demonstrations import decode, encode
from aerial_il.algorithms.rl.proximal import Proximal
from aerial_il.algorithms.rl.returns import advantages
from aerial_il.algorithms.rl.settings import OnPolicy
from aerial_il.policies.parts.layout import Interface
from aerial_il.policies.squashed_gaussian import SquashedGaussian


class Rollout(NamedTuple):
    """T steps of n worlds.

    Attributes:
        frames: (T, n, Do) in the world. obs, next_obs: (T, n, Do) encoded; ``next_obs`` was seen before any reset.
        actions: (T, n, Da) normalised. raw: (T, n, Da) before the tanh. density: (T, n) logarithm of their density.
        rewards: (T, n) of the environment. terminal, truncated: (T, n) bool; see :class:`Steps`.
    """

    frames: np.ndarray
    obs: np.ndarray
    next_obs: np.ndarray
    actions: np.ndarray
    raw: np.ndarray
    density: np.ndarray
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


def fly(flight: EndlessFlight, agent: Proximal, interface: Interface, steps: int) -> Rollout:
    """Fly ``steps`` environment steps of all worlds together, or a few more, with actions drawn by ``agent``."""
    rows: list[tuple[np.ndarray, ...]] = []
    for _ in range(-(-steps // flight.n)):
        frames, obs = flight.frames, encode(interface, flight.frames)
        actions, raw, density = agent.explore(obs)
        step = flight.step(decode(interface, actions, frames))
        after = encode(interface, step.next_frames)
        rows.append((frames, obs, after, actions, raw, density, step.rewards, step.terminal, step.truncated))
    return Rollout(*(np.stack(values) for values in zip(*rows, strict=True)))


def learn(
    agent: Proximal,
    rollout: Rollout,
    rewards: np.ndarray,
    settings: OnPolicy,
    *,
    left: float,
    end_values: np.ndarray | float = 0.0,
    improve: bool = True,
) -> dict[str, float]:
    """Update ``agent`` on a rollout.

    Args:
        rewards: (T, n) what each step is paid.
        left: share of the training that is left.
        end_values: (T, n) what all that follows is worth where a step was an end that matters; elsewhere of no effect.
        improve: whether the actor moves at all.
    """
    values, later = agent.values(rollout.obs), agent.values(rollout.next_obs)
    later = np.where(rollout.terminal, end_values, later)
    gains = advantages(rewards, values, later, rollout.ended, gamma=settings.gamma, decay=settings.decay)
    targets = (gains + values).ravel()
    shown = (rollout.flat("obs"), rollout.flat("raw"), gains.ravel(), targets)
    metrics = agent.update(*shown, left=left, improve=improve)
    return {**metrics, "critic/value": float(values.mean())}


def learner_of(settings: OnPolicy, actor: SquashedGaussian, obs_size: int) -> Proximal:
    """Return a new agent around ``actor``."""
    return Proximal(
        actor,
        obs_size,
        hidden=settings.critic_hidden,
        lr=settings.lr,
        clip=settings.clip,
        epochs=settings.epochs,
        batch_size=settings.batch_size,
        entropy=settings.entropy,
        clip_norm=settings.clip_norm,
        target_kl=settings.target_kl,
    )
