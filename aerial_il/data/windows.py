"""Training windows over demonstrations in memory: histories of observations and chunks of actions.

The frames of all episodes lie one after the other, each episode padded once with copies of its first observation and
its last action. A window is then a run of consecutive rows, so gathering a batch is one copy per window and needs no
index table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from typing import Literal, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.data.episode import Episode
from aerial_il.data.memory import MEMORY

BLOCK = 1 << 16  # rows at once
Rows = Callable[[np.ndarray], np.ndarray]
Frames = Mapping[str, Sequence[np.ndarray]]  # name -> of each kept episode (T or T + 1, *shape)
Target = Literal["actions", "executed_actions", "expert_actions"]


class Batch(NamedTuple):
    """B windows.

    Attributes:
        obs: (B, To, Do) the last To observations, the present one last.
        actions: (B, Ta, Da) the actions from now on.
        is_pad: (B, Ta) bool, True beyond the end of the episode and where nobody said what to do.
    """

    obs: np.ndarray
    actions: np.ndarray
    is_pad: np.ndarray


class Windows:
    """All windows of some episodes, one for each control step whose action is known.

    Args:
        episodes: where the frames come from; kept in no other form.
        obs_names: state fields, concatenated in this order.
        history: observations To in a window.
        chunk: actions Ta in a window.
        target: which actions. With ``expert_actions`` an episode in which nobody was asked falls back to what was
            executed; of one in which somebody was, only the labelled steps count: no window begins at another one, and
            within a window the others are padding.
        successes_only: leave failed episodes out.
        dtype: of observations and actions in memory.
        images: image fields that go with the observations. They stay as the episodes hold them, one copy of each frame
            however many windows show it, and are gathered by :meth:`images`.

    Attributes:
        lengths: (E,) windows of each episode.
        episode: (N,) in which of the kept episodes each window lies.

    Raises:
        InvalidValueError: no episode is left, or a length is not positive.
        UnknownNameError: an episode lacks a field.
    """

    def __init__(
        self,
        episodes: Iterable[Episode],
        obs_names: Sequence[str],
        *,
        history: int = 1,
        chunk: int = 1,
        target: Target = "actions",
        successes_only: bool = True,
        dtype: np.typing.DTypeLike = np.float32,
        images: Sequence[str] = (),
    ) -> None:
        if history < 1 or chunk < 1:
            raise InvalidValueError(f"history={history} and chunk={chunk} must be at least 1.")
        self.obs_names, self.history, self.chunk = tuple(obs_names), history, chunk
        chosen = [e for e in episodes if e.success or not successes_only]
        if not chosen:
            raise InvalidValueError("No episode is left to cut windows from: none succeeded. See successes_only.")
        self.image_names = tuple(images)
        self.frames = {name: [_image(e, name) for e in chosen] for name in self.image_names}
        known = [_known(e, target) for e in chosen]
        steps = self._steps = np.array([len(each) for each in known])
        obs = _joined((_obs(e, self.obs_names) for e in chosen), steps, dtype, before=history - 1)
        actions = _joined((_target(e, target) for e in chosen), steps, dtype, after=chunk - 1)
        self.lengths = np.array([int(each.sum()) for each in known])
        episode, step = np.repeat(np.arange(len(chosen)), steps), np.arange(steps.sum())
        starts = np.flatnonzero(np.concatenate(known))
        self._obs_row = (step + episode * (history - 1))[starts]
        self._action_row = (step + episode * (chunk - 1))[starts]
        first = np.cumsum(steps) - steps
        self.episode, self._step = episode[starts], (step - first[episode])[starts]
        is_pad = np.concatenate([np.pad(~each, (0, chunk - 1), constant_values=True) for each in known])
        self._is_pad_runs = sliding_window_view(is_pad, chunk)
        self._hold(obs, actions)

    def _hold(self, obs: np.ndarray, actions: np.ndarray) -> None:
        self._obs, self._actions = obs, actions
        self._obs_runs = sliding_window_view(obs.reshape(-1), self.history * obs.shape[1])
        self._action_runs = sliding_window_view(actions.reshape(-1), self.chunk * actions.shape[1])

    def mapped(self, of_obs: Rows, of_actions: Rows) -> Windows:
        """Return the same windows over what two functions, (n, D) to (n, D), make of the observations and actions."""
        result = copy(self)
        result._hold(_made(of_obs, self._obs), _made(of_actions, self._actions))
        return result

    def __len__(self) -> int:
        return len(self._action_row)

    def __getitem__(self, index: np.ndarray) -> Batch:
        """Gather the windows at ``index`` (B,)."""
        index = np.asarray(index)
        obs = self._obs_runs[self._obs_row[index] * self._obs.shape[1]]
        actions = self._action_runs[self._action_row[index] * self._actions.shape[1]]
        return Batch(
            obs.reshape(len(index), self.history, self._obs.shape[1]),
            actions.reshape(len(index), self.chunk, self._actions.shape[1]),
            self._is_pad_runs[self._action_row[index]],
        )

    def is_over(self, index: np.ndarray) -> np.ndarray:
        """Return (B, Ta) bool: which actions of the windows at ``index`` (B,) lie beyond the end of their episode."""
        return self._step[index, None] + np.arange(self.chunk) >= self._steps[self.episode[index], None]

    def present(self, index: np.ndarray) -> np.ndarray:
        """Gather the last observations (B, Do) of the windows at ``index`` (B,)."""
        return self._obs[self._obs_row[index] + self.history - 1]

    def images(self, index: np.ndarray) -> dict[str, np.ndarray]:
        """Gather the images that the windows at ``index`` (B,) show, by name, each ``(B, To, *shape)``."""
        return self.beside(self.frames, index)

    def beside(self, frames: Frames, index: np.ndarray) -> dict[str, np.ndarray]:
        """Gather what ``frames`` have in the steps that the windows at ``index`` (B,) show, each (B, To, *shape)."""
        if not frames:
            return {}
        behind = np.arange(1 - self.history, 1)
        rows = np.maximum(self._step[index, None] + behind, 0)
        places = list(zip(self.episode[index].tolist(), rows, strict=True))
        return {name: np.stack([of[e][r] for e, r in places]) for name, of in frames.items()}

    def batches(self, size: int, rng: np.random.Generator) -> Iterator[Batch]:
        """Yield one epoch in random order, without the incomplete last batch."""
        order = rng.permutation(len(self))
        for start in range(0, len(order) - size + 1, size):
            yield self[order[start : start + size]]


def _joined(
    parts: Iterable[np.ndarray], steps: np.ndarray, dtype: np.typing.DTypeLike, *, before: int = 0, after: int = 0
) -> np.ndarray:
    """Return parts (T, D) of so many ``steps`` one after the other, each with copies of its first or last row."""
    joined, start = np.empty((0, 0), dtype), 0
    for part in parts:
        if not start:
            joined = MEMORY.empty((int(steps.sum()) + len(steps) * (before + after), part.shape[1]), dtype)
        first, last = start + before, start + before + len(part)
        joined[start:first], joined[first:last], joined[last : last + after] = part[0], part, part[-1]
        start = last + after
    return joined


def _made(function: Rows, rows: np.ndarray) -> np.ndarray:
    made = MEMORY.empty((len(rows), function(rows[:1]).shape[1]), np.float32)
    for start in range(0, len(rows), BLOCK):
        made[start : start + BLOCK] = function(rows[start : start + BLOCK])
    return made


def _obs(episode: Episode, names: tuple[str, ...]) -> np.ndarray:
    return episode.flat_obs(names)[: len(episode)] if names else np.zeros((len(episode), 0))


def _image(episode: Episode, name: str) -> np.ndarray:
    if name not in episode.obs:
        there = [field.name for field in episode.spec.observation.of_group("image") if field.name in episode.obs]
        raise UnknownNameError("image", name, there, f"Open the recordings with cameras=[{name!r}].")
    return episode.obs[name]


def _target(episode: Episode, target: Target) -> np.ndarray:
    return episode.labels if target == "expert_actions" else getattr(episode, target)


def _known(episode: Episode, target: Target) -> np.ndarray:
    """(T,) bool: the steps whose target is worth learning."""
    return episode.known if target == "expert_actions" else np.ones(len(episode), bool)
