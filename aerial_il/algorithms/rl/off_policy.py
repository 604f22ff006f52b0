"""Off-policy learning: settings, and the collection of one transition of every world for the replay buffer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from aerial_il.algorithms.off_policy import settings
from aerial_il.algorithms.off_policy.exploration import Explorer
from aerial_il.algorithms.online.collector import Collector
from aerial_il.algorithms.online.interface import decode, encode
from aerial_il.algorithms.online.problem import whole_turns
from aerial_il.algorithms.online.replay_buffer import rows_of
from aerial_il.algorithms.rl.algorithm import OnlineAlgorithm
from aerial_il.algorithms.run.checks import require_positive, require_share, require_widths
from aerial_il.policies.parts.critics import Critics
from aerial_il.policies.parts.layout import Interface


@dataclass(frozen=True, kw_only=True)
class OffPolicy(OnlineAlgorithm):
    """Settings of runs that learn from a replay buffer.

    Attributes:
        warmup: environment steps with random actions (``dqn``: epsilon-greedy ones), before anything is learned;
            ``ibrl`` flies its prior instead, and already learns.
        utd_ratio: gradient steps of the critics for each environment step (update-to-data ratio).
        batch_size: transitions in a minibatch.
        buffer_size: transitions kept.
        lr: learning rate of all that is learned, at the start; it changes linearly.
        lr_floor: what is left of it at the end, as a share; 1 for all. Below that the final policy swings less.
        tau: share by which target networks follow at each update (Polyak averaging).
    """

    warmup: int = 5_000
    utd_ratio: float = 1.0
    batch_size: int = 256
    buffer_size: int = 1_000_000
    lr: float = 3e-4
    lr_floor: float = 1.0
    tau: float = 0.005

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "warmup", "utd_ratio", "batch_size", "buffer_size", "lr", "tau")
        require_share(self, "lr_floor", "tau")

    def flown_before_learning(self, worlds: int) -> dict[str, int]:
        last = 0 if self.lr_floor else worlds  # the last turn, where no learning rate is left
        return {"warmup": whole_turns(self.warmup, worlds) + last}

    def lr_at(self, left: float) -> float:
        """Return the learning rate when the share ``left`` of the training is left."""
        return self.lr * (self.lr_floor + (1.0 - self.lr_floor) * left)


@dataclass(frozen=True, kw_only=True)
class OffPolicyActorCritic(OffPolicy):
    """Settings of those that have an actor, which action-value critics improve.

    Attributes:
        actor_every: how many of the critics' gradient steps for each one of the actor.
        critic_hidden: widths of the critics.
        critic_norm: standardise each hidden layer of the critics (LayerNorm), which bounds their values of actions
            that were never tried (P. Ball et al., "Efficient Online Reinforcement Learning with Offline Data", 2023,
            section 4.2).
    """

    actor_every: int = 2
    critic_hidden: tuple[int, ...] = (256, 256)
    critic_norm: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "actor_every")
        require_widths(self, "critic_hidden")

    def build_critics(self, inputs: int, count: int = 2) -> Critics:
        """Return new critics of so many ``inputs``: an observation's, one for the absorbing state, an action's."""
        return Critics(inputs, self.critic_hidden, count, layer_norm=self.critic_norm)


@dataclass(frozen=True, kw_only=True)
class SoftOffPolicy(OffPolicyActorCritic):
    """Settings of those whose actor is rewarded for its entropy as well.

    Attributes:
        alpha: temperature at the start: weight of the entropy beside the reward.
        entropy: target entropy for each action element.
    """

    alpha: float = 0.1
    entropy: float = -1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "alpha")

    @property
    def critics(self) -> settings.Critics:
        """As :class:`SAC` groups them, for those that train its networks, until they state groups of their own."""
        return settings.Critics(count=2, hidden=self.critic_hidden, layer_norm=self.critic_norm, tau=self.tau)

    @property
    def replay(self) -> settings.Replay:
        return settings.Replay(capacity=self.buffer_size, batch_size=self.batch_size, updates_per_step=self.utd_ratio)


class Collected(NamedTuple):
    """One step of n worlds.

    Attributes:
        obs, next_obs: (n, Do) encoded; ``next_obs`` was seen before any reset.
        actions: (n, Da) normalised.
        rewards: (n,) of the environment, penalties subtracted.
        terminal: (n,) bool, the episode ended because of what happened. success: (n,) bool, the task is done.
        penalties: (n,) for rough actions.
    """

    obs: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray
    next_obs: np.ndarray
    terminal: np.ndarray
    success: np.ndarray
    penalties: np.ndarray

    def rows(self, *, absorbing: bool | np.ndarray) -> np.ndarray:
        """Return them as rows of a replay buffer; see :func:`rows_of`."""
        return rows_of(*self[:5], absorbing=absorbing, penalties=self.penalties)


def collect_step(collector: Collector, interface: Interface, explorer: Explorer) -> Collected:
    """Take one step in all worlds with actions sampled by ``explorer``."""
    obs = encode(interface, collector.frames)
    actions = explorer.explore(obs)
    step = collector.step(decode(interface, np.asarray(actions, np.float32), collector.frames))
    after = encode(interface, step.next_frames)
    return Collected(obs, actions, step.rewards, after, step.terminal, step.success, step.penalties)
