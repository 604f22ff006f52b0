"""Settings that all algorithms of supervised learning share, and what they decide."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import torch

from aerial_il.algorithms.run.cadence import CADENCE, Evaluate
from aerial_il.algorithms.run.checks import require_not_negative, require_positive, require_share
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import PolicySettings

SUCCESS = "success"


@dataclass(frozen=True, kw_only=True)
class SupervisedAlgorithm(ABC):
    """Settings of every run of supervised learning.

    Attributes:
        steps: optimisation steps.
        minutes: end after this time even if steps are left; the schedule then follows the time, and the result depends
            on the speed of the machine. None for steps alone.
        validation: share of the episodes held out to report the error per action element.
        best_by: number of the rollouts by which the best policy on the way is kept.
        patience: evaluations by rollouts in a row, none better than the best, after which it ends; 0 for never.
            The learning rate is then still high, so that the policy may be worse than at the end of a whole run.
        log_every, validate_every, evaluate_every, checkpoint_every: steps between two; 0 for never.
        keep_checkpoints: how many of the newest stay on disk.
        device: torch device.
        mixed_precision: compute in bfloat16 where that loses little, on a GPU; a CPU always computes in float32.
        threads: torch threads; results repeat bit for bit at a fixed number only.
        name: of the algorithm, that of its module.
        needs, rewarded, demonstrated, worlds: it flies nowhere and learns from demonstrations alone.
    """

    name: ClassVar[str]
    needs: ClassVar[tuple[str, ...]] = ()
    rewarded: ClassVar[bool] = False
    demonstrated: ClassVar[bool] = True
    worlds: ClassVar[int] = 1

    steps: int = 10_000
    minutes: float | None = None
    validation: float = 0.05
    best_by: str = SUCCESS
    patience: int = 0
    log_every: int = 100
    validate_every: int = 1000
    evaluate_every: int = 0
    checkpoint_every: int = 1000
    keep_checkpoints: int = 3
    device: str = "cpu"
    mixed_precision: bool = False
    threads: int = 1

    def __post_init__(self) -> None:
        require_positive(self, "steps", "keep_checkpoints", "threads")
        require_share(self, "validation", below_one=True)
        require_not_negative(self, "patience", "log_every", "validate_every", "evaluate_every", "checkpoint_every")
        if self.minutes is not None and self.minutes <= 0:
            raise InvalidValueError(f"minutes is {self.minutes}; it must be positive, or null for no limit.")
        if self.patience and not self.evaluate_every:
            raise InvalidValueError(f"patience is {self.patience}; it needs rollouts: set evaluate_every too.")

    @abstractmethod
    def train(
        self,
        dataset: Iterable[Episode],
        policy: PolicySettings,
        *,
        run: str | os.PathLike[str],
        seed: int = 0,
        expect: Mapping[str, str] | None = None,
        evaluate: Evaluate | None = None,
        resume: bool = True,
        progress: bool = True,
        failures: bool = False,
        weights: Sequence[float] | None = None,
        initial: ChunkPolicy | None = None,
    ) -> ChunkPolicy:
        """Learn from ``dataset``; see :meth:`aerial_il.algorithms.bc.BC.train`."""

    @property
    def cadence(self) -> tuple[str, ...]:
        """Settings that no weight depends on; with patience the rollouts decide where training ends."""
        return tuple(name for name in CADENCE if not (self.patience and name == "evaluate_every"))

    def progress_at(self, step: int, elapsed_s: float) -> float:
        """Return the share of the training that is done, by steps or by time."""
        return max(step / self.steps, elapsed_s / (60 * self.minutes) if self.minutes else 0.0)

    def precision(self) -> torch.autocast:
        """Return the context in which the loss is computed."""
        mixed = self.mixed_precision and self.device.startswith("cuda")
        return torch.autocast("cuda" if mixed else "cpu", dtype=torch.bfloat16, enabled=mixed)


def require_device(name: str) -> None:
    """Refuse a torch device that is not there, or that there cannot be."""
    try:
        device = torch.device(name)
    except RuntimeError as error:
        raise InvalidValueError(f"device={name} is none that torch knows. Use cpu, cuda or cuda:1.") from error
    found = torch.cuda.device_count()
    if device.type == "cuda" and not found:
        raise InvalidValueError(f"device={name} needs a GPU that torch can use; there is none here. Use device=cpu.")
    if device.type == "cuda" and (device.index or 0) >= found:
        raise InvalidValueError(f"device={name}: there are {found} GPUs here, counted from 0.")
