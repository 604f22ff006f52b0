"""A replay buffer of transitions with absorbing states, one transition a row, so that a minibatch is one gather.

An absorbing state stands for everything after an episode's end. It has a reward of its own, learned like any other;
without it a reward that is always positive rewards staying alive and one that is always negative rewards dying,
whatever the demonstrator did. It is the last observation with a mark on it, for ever: were it the same state for all
ends, as in the source, a crash would lead where the demonstrator's success leads, and an agent that still does badly,
whose every step has a lower reward than that state, would learn to crash.

Source: I. Kostrikov et al., "Discriminator-Actor-Critic", 2019, section 4.2.
"""

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from aerial_il.algorithms.run.state import Snapshot
from aerial_il.algorithms.run.train_state import TrainState
from aerial_il.policies.parts.layout import Interface
from aerial_il.policies.parts.network import ChunkNetwork


class Batch(NamedTuple):
    """B transitions.

    Attributes:
        obs, next_obs: (B, Do + 1) encoded observations; the last column is 1 in the absorbing state, else 0.
        actions: (B, Da) normalised.
        rewards: (B,).
        continues: (B,) 1 where the target bootstraps from ``next_obs``, 0 where the action was terminal.
    """

    obs: Tensor
    actions: Tensor
    next_obs: Tensor
    rewards: Tensor
    continues: Tensor


def rows_of(
    obs: np.ndarray,
    actions: np.ndarray,
    rewards: np.ndarray,
    next_obs: np.ndarray,
    terminal: np.ndarray,
    *,
    absorbing: bool | np.ndarray,
    penalties: np.ndarray | float = 0.0,
) -> np.ndarray:
    """Lay transitions out as rows ``obs, 0, actions, next_obs, absorbed, reward, continues``.

    Args:
        obs, next_obs: (T, Do) encoded. actions: (T, Da) normalised. rewards: (T,).
        terminal: (T,) bool, ended because of what happened; truncated episodes do not count.
        absorbing: whether a terminal action leads to an absorbing state (``next_obs`` and a one), which leads to itself
            with an action of zeros and the same reward; that transition is one more row for each of them. Otherwise
            the value after a terminal action is zero. One for all, or (T,) bool.
        penalties: (T,) subtracted in ``rewards`` for rough actions. In an absorbing state nobody acts: its reward is
            the one without.

    Returns:
        (T + number of ends, 2 Do + Da + 4) float32.
    """
    flags = np.zeros((len(obs), 1), np.float32)
    absorbed = terminal & absorbing
    continues = np.where(terminal & ~absorbed, 0.0, 1.0)[:, None]
    rows = np.concatenate([obs, flags, actions, next_obs, absorbed[:, None], rewards[:, None], continues], axis=1)
    if not absorbed.any():
        return rows.astype(np.float32)
    width, ends = obs.shape[1] + 1, rows[absorbed]
    after = ends[:, -width - 2 : -2]  # the end's observation and its mark
    paid = (rewards + penalties)[absorbed, None]
    loop = np.concatenate([after, np.zeros((len(ends), actions.shape[1])), after, paid, ends[:, -1:]], axis=1)
    return np.concatenate([rows, loop]).astype(np.float32)


class ReplayBuffer:
    """The last ``capacity`` rows and the generator that samples from them.

    Args:
        capacity: rows kept.
        obs_size, action_size: Do and Da.
        rng: decides which rows a minibatch takes.
    """

    def __init__(self, capacity: int, obs_size: int, action_size: int, rng: np.random.Generator) -> None:
        self._widths = (obs_size + 1, action_size, obs_size + 1, 1, 1)
        self._rows = torch.zeros(capacity, sum(self._widths))
        self._rng, self._size, self._at = rng, 0, 0

    def __len__(self) -> int:
        return self._size

    def add(self, rows: np.ndarray) -> None:
        """Keep rows (m, W) of :func:`rows_of`, in the places of the oldest where there is no other."""
        capacity = len(self._rows)
        after, kept = (self._at + len(rows)) % capacity, rows[-capacity:]
        places = (after - len(kept) + np.arange(len(kept))) % capacity
        self._rows[torch.from_numpy(places)] = torch.from_numpy(kept)
        self._at, self._size = int(after), min(capacity, self._size + len(rows))

    def sample(self, count: int) -> Batch:
        """Sample ``count`` transitions with replacement."""
        index = torch.from_numpy(self._rng.integers(0, self._size, count))
        return split(self._rows.index_select(0, index), self._widths)

    def standardise(self, interface: Interface) -> None:
        """Let rows that were kept with plain observations be as if ``interface`` had standardised them."""
        obs, _, next_obs, _, _ = self._rows[: self._size].split(self._widths, dim=1)
        for seen in (obs[:, :-1], next_obs[:, :-1]):
            seen.copy_(torch.from_numpy(interface.normalise_obs(seen.numpy())))

    def snapshot(self) -> Snapshot:
        values = {"at": self._at, "rng": self._rng.bit_generator.state}
        return Snapshot({"rows": self._rows[: self._size].numpy()}, values)

    def restore(self, saved: Snapshot) -> None:
        rows = torch.from_numpy(saved.arrays["rows"].copy())
        self._size, self._at = len(rows), saved.values["at"]
        self._rows[: self._size] = rows
        self._rng.bit_generator.state = saved.values["rng"]


def bc_pretrain[Network: nn.Module](
    trained: TrainState[Network], actor: ChunkNetwork, demos: ReplayBuffer, *, steps: int, batch_size: int
) -> None:
    """Move ``actor``'s mean action towards demonstrated ones in ``steps`` minibatches of ``trained``'s optimiser."""
    for _ in range(steps):
        trained.descend(bc_loss(actor, demos.sample(batch_size)))


def bc_loss(actor: ChunkNetwork, demos: Batch) -> Tensor:
    """Return the squared distance of the actor's mean action from demonstrated actions, summed over elements."""
    distance = ((actor(demos.obs[:, None, :-1])[:, 0] - demos.actions) ** 2).sum(1)
    return ((1.0 - demos.obs[:, -1]) * distance).mean()


def split(rows: Tensor, widths: tuple[int, ...]) -> Batch:
    """Take rows (B, W) apart."""
    obs, actions, next_obs, rewards, continues = rows.split(widths, dim=1)
    return Batch(obs, actions, next_obs, rewards[:, 0], continues[:, 0])


def alive(batch: Batch) -> Batch:
    """Return transitions that are rewarded by 1 for each step before an end."""
    return batch._replace(rewards=1.0 - batch.obs[:, -1])


def concatenated(first: Batch, second: Batch) -> Batch:
    """Put two minibatches one after the other."""
    return Batch(*(torch.cat(pair) for pair in zip(first, second, strict=True)))


def mixed(shown: ReplayBuffer, flown: ReplayBuffer, count: int, share: float) -> Batch:
    """Sample ``count`` transitions, that ``share`` of them demonstrated ones and the others flown ones."""
    first = round(share * count)
    if first in (0, count):
        return (shown if first else flown).sample(count)
    return concatenated(shown.sample(first), flown.sample(count - first))
