"""Demonstrations as tensors in memory, and minibatches gathered from them by index."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from aerial_il.core.errors import InvalidValueError, NonFiniteActionError
from aerial_il.core.seeding import named_rng
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.layout import Interface, Layout
from aerial_il.policies.parts.network import PolicyConfig
from aerial_il.policies.parts.normaliser import Normaliser

VALIDATE = "Find out more: aerial-il validate PATH"


class Demo(NamedTuple):
    """One demonstration: frames (T, Do) in SI units and what the demonstrator would do there (T, Da).

    The latter is the expert's label where there is one, else the action that was flown.
    """

    obs: np.ndarray
    actions: np.ndarray


@dataclass(frozen=True, eq=False)
class Frames:
    """All steps of several demonstrations, one after the other.

    Attributes:
        obs: (N, Do) frames as the policy's layout makes them.
        actions: (N, Da).
        first, last: (N,) index of the first and of the last step of the demonstration that each step belongs to.
    """

    obs: np.ndarray
    actions: np.ndarray
    first: np.ndarray
    last: np.ndarray

    @staticmethod
    def of(demos: Sequence[Demo]) -> Frames:
        """Put ``demos`` one after the other."""
        lengths = np.array([len(demo.obs) for demo in demos])
        ends = np.cumsum(lengths)
        first, last = np.repeat(ends - lengths, lengths), np.repeat(ends - 1, lengths)
        return Frames(np.concatenate([d.obs for d in demos]), np.concatenate([d.actions for d in demos]), first, last)

    @property
    def digest(self) -> str:
        """SHA-256 over everything that a network can learn from."""
        seal = hashlib.sha256()
        for array, kind in ((self.obs, "<f8"), (self.actions, "<f8"), (self.first, "<i8")):
            seal.update(np.ascontiguousarray(array, kind).tobytes())
        return seal.hexdigest()

    def ahead(self, steps: int) -> np.ndarray:
        """Return the indices (N, steps) of what follows each step, repeating the last one after an episode's end."""
        return np.minimum(np.arange(len(self.obs))[:, None] + np.arange(steps), self.last[:, None])


def read_demos(dataset: Iterable[Episode], policy: PolicyConfig) -> tuple[Layout, list[Demo]]:
    """Read what ``policy`` needs of every successful episode, refusing what nothing should learn from.

    Raises:
        InvalidValueError: there is no success, episodes come from different environments, one is shorter than the
            policy's chunk, or a value is not finite.
        UnknownNameError: the episodes lack an observation field.
    """
    layout, demos = None, []
    for episode in dataset:
        if not episode.success:
            continue
        layout = layout or Layout.of(episode.spec, policy.obs_names, policy.anchor)
        if differing := layout.spec.differences(episode.spec):
            raise InvalidValueError(f"Episode {episode.uid} comes from another environment: {'; '.join(differing)}.")
        demos.append(_read(episode, layout, policy.chunk))
    if layout is None:
        hint = "Record some: aerial-il collect robot=R task=T episodes=100 out=datasets/NAME"
        raise InvalidValueError(f"The dataset holds no successful demonstration. {hint}")
    return layout, demos


def _read(episode: Episode, layout: Layout, chunk: int) -> Demo:
    if len(episode) < chunk:
        raise InvalidValueError(f"Episode {episode.uid} has {len(episode)} steps; chunk={chunk} must not be longer.")
    try:
        obs = layout.frame(episode.obs)[: len(episode)]
    except NonFiniteActionError as error:
        step = min(error.worlds)  # of a single episode the leading axis is time
        raise InvalidValueError(
            f"Episode {episode.uid}: {error.what} is not finite at step {step}. {VALIDATE}"
        ) from error
    actions = np.where(np.isfinite(episode.expert_actions), episode.expert_actions, episode.executed_actions)
    if not np.isfinite(actions).all():
        step = int(np.argmin(np.isfinite(actions).all(1)))
        raise InvalidValueError(f"Episode {episode.uid}: the action is not finite at step {step}. {VALIDATE}")
    return Demo(obs, actions)


def split(demos: Sequence[Demo], fraction: float, *, seed: int) -> tuple[list[Demo], list[Demo]]:
    """Draw ``fraction`` of the demonstrations, at least one where there are two, for validation.

    Returns:
        Those to train on and those to validate on, each in their order.
    """
    count = min(len(demos) - 1, max(1, round(fraction * len(demos)))) if fraction > 0 else 0
    held = set(named_rng(seed, "validation split").permutation(len(demos))[:count].tolist())
    return [d for i, d in enumerate(demos) if i not in held], [d for i, d in enumerate(demos) if i in held]


def fit_interface(layout: Layout, config: PolicyConfig, frames: Frames) -> Interface:
    """Fit the normalisers of ``layout`` to ``frames``, that of anchored actions to their offsets over a whole chunk."""
    action = Normaliser.fit(frames.actions, config.action_scaling)
    if width := layout.anchored:
        offsets = frames.actions[frames.ahead(config.chunk), :width] - layout.anchor_of(frames.obs)[:, None]
        relative = Normaliser.fit(offsets.reshape(-1, width), config.action_scaling)
        action = Normaliser(
            np.concatenate([relative.centre, action.centre[width:]]),
            np.concatenate([relative.scale, action.scale[width:]]),
        )
    return Interface(layout, Normaliser.fit(frames.obs), action)


class TrainingSet:
    """Normalised frames from which windows are gathered: histories behind each step and chunks of actions ahead.

    Before an episode's start its first observation is repeated, after its end its last action, marked as not valid.
    """

    def __init__(self, frames: Frames, interface: Interface, config: PolicyConfig, device: str = "cpu") -> None:
        obs = interface.obs.normalise(frames.obs).clip(-config.obs_clip, config.obs_clip)
        anchor = interface.layout.anchor_of(frames.obs) / interface.action.scale[: interface.layout.anchored]
        arrays = (obs, interface.action.normalise(frames.actions), anchor.astype(np.float32), frames.first, frames.last)
        tensors = (torch.as_tensor(array, device=device) for array in arrays)
        self._obs, self._actions, self._anchor, self._first, self._last = tensors
        self._back = torch.arange(1 - config.history, 1, device=device)
        self._ahead = torch.arange(config.chunk, device=device)

    def __len__(self) -> int:
        return len(self._obs)

    def gather(self, steps: np.ndarray) -> tuple[Tensor, Tensor, Tensor]:
        """Return obs (B, To, Do), actions (B, Ta, Da), valid (B, Ta) of the windows at ``steps`` (B,)."""
        now = torch.as_tensor(steps, device=self._obs.device)[:, None]
        first, last, ahead = self._first[now], self._last[now], now + self._ahead
        actions = self._actions[torch.minimum(ahead, last)]
        actions[..., : self._anchor.shape[-1]] -= self._anchor[now]
        return self._obs[torch.maximum(now + self._back, first)], actions, (ahead <= last).float()


class Shuffle:
    """The order in which steps are visited: a fresh permutation each epoch, a function of the seed alone.

    Args:
        size: number of windows.
        batch: windows in a minibatch.
        seed: decides the permutations.
    """

    def __init__(self, size: int, batch: int, *, seed: int) -> None:
        self.size, self.batch, self.seed = size, batch, seed
        self._epoch, self._order = -1, np.zeros(0, np.int64)

    def __getitem__(self, step: int) -> np.ndarray:
        """Return the windows (B,) of optimisation step ``step``."""
        epochs, places = np.divmod(np.arange(step * self.batch, (step + 1) * self.batch), self.size)
        return np.concatenate([self._permutation(int(e))[places[epochs == e]] for e in np.unique(epochs)])

    def _permutation(self, epoch: int) -> np.ndarray:
        if epoch != self._epoch:
            self._epoch = epoch
            self._order = named_rng(self.seed, "minibatches", str(epoch)).permutation(self.size)
        return self._order
