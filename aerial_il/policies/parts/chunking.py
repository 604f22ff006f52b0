"""Memory of a policy that flies n worlds: the observations behind it and the actions it has planned.

Both classes keep one row per world, and a row starts afresh when its world is reset, whatever the others do.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from aerial_il.core.errors import InvalidValueError


class ObservationHistory:
    """The last ``length`` observations of each world; before there are as many, the first one is repeated."""

    def __init__(self, length: int) -> None:
        self.length = length
        self._frames = np.zeros((0, length, 0))
        self._fresh = np.zeros(0, bool)

    def push(self, frame: np.ndarray) -> np.ndarray:
        """Append ``frame`` (n, ...) and return the history (n, To, ...), oldest first."""
        if not len(self._frames):
            self._frames = np.empty((len(frame), self.length, *frame.shape[1:]), frame.dtype)
            self._fresh = np.ones(len(frame), bool)
        self._frames[:, :-1] = self._frames[:, 1:]
        self._frames[:, -1] = frame
        if self._fresh.any():
            self._frames[self._fresh] = frame[self._fresh, None]
            self._fresh[:] = False
        return self._frames

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Forget the worlds in ``mask`` (n,), or all of them and their number."""
        if mask is None:
            self._frames = self._frames[:0]
        elif len(self._frames):
            self._fresh |= mask

    def memory(self) -> dict[str, np.ndarray]:
        """Return copies of all that is remembered."""
        return {"frames": self._frames.copy(), "fresh": self._fresh.copy()}

    def recall(self, memory: Mapping[str, np.ndarray]) -> None:
        """Remember what :meth:`memory` returned."""
        self._frames, self._fresh = memory["frames"].copy(), memory["fresh"].copy()


class ActionPlan:
    """The actions planned for the next Ta steps of each world, from every chunk predicted so far.

    A new chunk is due every ``execute`` steps. Where chunks overlap, their mean with the weights
    ``exp(-coefficient * i)`` is flown, i = 0 being the oldest chunk (temporal ensembling). Without a coefficient the
    newest chunk replaces the older ones (receding horizon).

    Source: T. Zhao et al., "Learning Fine-Grained Bimanual Manipulation with Low-Cost Hardware", 2023, section IV-C.

    Args:
        chunk: actions Ta in a chunk.
        execute: steps between two chunks, in [1, chunk].
        coefficient: decay of the weights; None for the newest chunk alone.
        delay: actions at the front of every chunk that come too late to be flown.
        thinking: how many of these are flown, as planned before, while the chunk is thought of; the others were sent
            before it was asked for, and as many are kept.
    """

    def __init__(
        self, chunk: int, execute: int = 1, coefficient: float | None = 0.01, *, delay: int = 0, thinking: int = 0
    ) -> None:
        if not 1 <= execute <= chunk:
            raise InvalidValueError(f"execute is {execute}; it must lie in [1, {chunk}], the length of a chunk.")
        if not 0 <= delay <= chunk - execute:
            raise InvalidValueError(
                f"A delay of {delay} steps must lie in [0, {chunk - execute}]: of {chunk} actions in a chunk {execute} "
                "are flown. Train with a longer policy.chunk, or a shorter policy.execute."
            )
        chunk, self.delay, self.thinking = chunk - delay, delay, thinking
        self._before = max(0, delay - thinking)  # actions that are kept
        self._sent, self._known = np.zeros((0, self._before, 0), np.float32), np.zeros((0, self._before), bool)
        self.chunk, self.execute, self.coefficient = chunk, execute, coefficient
        self._weight = np.exp(-(coefficient or 0.0) * np.arange(chunk + 1)).astype(np.float32)
        self._total = np.concatenate([[0.0], np.cumsum(self._weight)]).astype(np.float32)
        self._mean = np.zeros((0, chunk, 0), np.float32)  # (n, Ta, Da)
        self._count = np.zeros((0, chunk), np.int64)  # chunks in the mean, per future step
        self._age = np.zeros(0, np.int64)  # steps since the last chunk

    def due(self, n: int) -> np.ndarray:
        """Return which of ``n`` worlds need a new chunk now, (n,) bool."""
        if not len(self._mean):
            return np.ones(n, bool)
        return (self._age >= self.execute) | (self._count[:, 0] == 0)

    def add(self, chunks: np.ndarray, mask: np.ndarray) -> None:
        """Fold the chunks (m, Ta, Da) of the m worlds in ``mask`` (n,) into their plans."""
        if not len(self._mean):
            self._mean = np.zeros((len(mask), self.chunk, chunks.shape[2]), np.float32)
            self._count, self._age = np.zeros((len(mask), self.chunk), np.int64), np.zeros(len(mask), np.int64)
            self._sent = np.zeros((len(mask), self._before, chunks.shape[2]), np.float32)
            self._known = np.zeros((len(mask), self._before), bool)
        rows, chunks = slice(None) if mask.all() else mask, chunks[:, self.delay :]
        if self.coefficient is None:
            self._mean[rows] = chunks
            self._count[rows] = 1
        else:
            count = self._count[rows]
            share = (self._weight[count] / self._total[count + 1])[..., None]
            self._mean[rows] += share * (chunks - self._mean[rows])
            self._count[rows] = count + 1
        self._age[rows] = 0

    @property
    def ready(self) -> bool:
        """Whether every world has a next action."""
        return bool(len(self._mean)) and bool((self._count[:, 0] > 0).all())

    def pop(self) -> np.ndarray:
        """Take the next action (n, Da) of every world out of its plan."""
        action = self._mean[:, 0].copy()
        self._mean[:, :-1] = self._mean[:, 1:]
        self._count[:, :-1] = self._count[:, 1:]
        self._mean[:, -1] = self._count[:, -1] = 0
        self._age += 1
        if self._before:
            self._sent = np.concatenate([self._sent, action[:, None]], 1)[:, 1:]
            self._known = np.pad(self._known, ((0, 0), (0, 1)), constant_values=True)[:, 1:]
        return action

    def empty(self) -> ActionPlan:
        """Return another one that is alike, with nothing planned."""
        chunk, delay, thinking = self.chunk + self.delay, self.delay, self.thinking
        return ActionPlan(chunk, self.execute, self.coefficient, delay=delay, thinking=thinking)

    def committed(self, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Return, for the worlds in ``mask`` (n,), the actions that were sent since what is seen now, or are planned.

        Returns:
            (m, Ta, Da), and where there are any, (m, Ta) bool; a world that has sent too few has none. None before the
            first chunk.
        """
        if not len(self._mean):
            return None
        actions, known = np.concatenate([self._sent, self._mean], 1), np.concatenate([self._known, self._count > 0], 1)
        known, short = known & self._known.all(1, keepdims=True), self.delay - self._before
        return np.pad(actions, ((0, 0), (0, short), (0, 0)))[mask], np.pad(known, ((0, 0), (0, short)))[mask]

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Forget the plans of the worlds in ``mask`` (n,), or all of them and their number."""
        if mask is None:
            self._mean = self._mean[:0]
        elif len(self._mean):
            self._mean[mask] = self._count[mask] = 0
            self._known[mask] = False

    def memory(self) -> dict[str, np.ndarray]:
        """Return copies of all that is planned, and of what was sent where that is kept."""
        sent = {"sent": self._sent.copy(), "known": self._known.copy()} if self._before else {}
        return {"mean": self._mean.copy(), "count": self._count.copy(), "age": self._age.copy(), **sent}

    def recall(self, memory: Mapping[str, np.ndarray]) -> None:
        """Plan what :meth:`memory` returned."""
        self._mean, self._count, self._age = (memory[name].copy() for name in ("mean", "count", "age"))
        if self._before:
            self._sent, self._known = memory["sent"].copy(), memory["known"].copy()
