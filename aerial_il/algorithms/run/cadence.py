"""The cadence of a run: when it logs, evaluates and takes checkpoints; no weight depends on it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from aerial_il.core.checks import require_not_negative, require_positive
from aerial_il.policies.parts.chunk_policy import ChunkPolicy

Evaluate = Callable[[ChunkPolicy, int], Mapping[str, float]]  # (policy, step) -> named numbers
CADENCE = ("log_every", "validate_every", "evaluate_every", "checkpoint_every", "keep_checkpoints", "reward_patience")


@dataclass(frozen=True, kw_only=True)
class Cadence:
    """When a run reports and saves.

    Attributes:
        log_every: steps between two rows of the metrics; 0 for never.
        evaluate_every: steps between two evaluations by rollouts; 0 for never.
        checkpoint_every: steps between two checkpoints; 0 for never.
        keep_checkpoints: how many of the newest stay on disk.
    """

    log_every: int
    evaluate_every: int
    checkpoint_every: int
    keep_checkpoints: int

    def __post_init__(self) -> None:
        require_positive(self, "keep_checkpoints")
        require_not_negative(self, "log_every", "evaluate_every", "checkpoint_every")


def due(every: int, step: int, *, since: int | None = None) -> bool:
    """Whether a multiple of ``every`` (0 for never) is ``step``, or lies in ``(since, step]``."""
    before = step - 1 if since is None else since
    return every > 0 and step // every > before // every
