"""The cadence of a run: when it logs, evaluates and takes checkpoints; no weight depends on it."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from aerial_il.policies.parts.chunk_policy import ChunkPolicy

Evaluate = Callable[[ChunkPolicy, int], Mapping[str, float]]  # (policy, step) -> named numbers
CADENCE = ("log_every", "validate_every", "evaluate_every", "checkpoint_every", "keep_checkpoints", "reward_patience")


def due(every: int, step: int, *, since: int | None = None) -> bool:
    """Whether a multiple of ``every`` (0 for never) is ``step``, or lies in ``(since, step]``."""
    before = step - 1 if since is None else since
    return every > 0 and step // every > before // every
