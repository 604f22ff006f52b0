"""Contracts between the rooms: what an algorithm offers.

They are structural: a class fulfils one by having its attributes, whether it names it or not.
"""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from aerial_il.core.policy import Policy


@runtime_checkable
class Algorithm(Protocol):
    """Settings of a training, a frozen dataclass that checks itself, and the training itself.

    Each module of ``aerial_il.algorithms`` holds one; its file is all that adding an algorithm takes.
    """

    @property
    def name(self) -> str:
        """Name of its module."""
        ...

    @property
    def needs(self) -> tuple[str, ...]:
        """What :meth:`train` is handed by name besides: any of ``env``, ``expert`` and ``collect``."""
        ...

    @property
    def worlds(self) -> int:
        """How many worlds it acts in at once, if nobody says otherwise."""
        ...

    @property
    def rewarded(self) -> bool:
        """Whether it learns from the environment's reward, and so without demonstrations."""
        ...

    @property
    def evaluate_every(self) -> int:
        """Steps or rounds between two calls of ``evaluate``; 0 for the last alone, or for none."""
        ...

    def train(self, dataset: Any, policy: Any, *args: Any, **kwargs: Any) -> Policy:
        """Train a policy, or go on where an earlier call was stopped, with the same bytes in the end.

        Args:
            dataset: episodes to learn from; None for an algorithm that is ``rewarded``.
            policy: configuration of the policy to train.
            kwargs: ``run`` (the folder), ``seed``, ``evaluate`` (``(policy, step) -> named numbers``), ``resume``,
                ``progress``, and what it ``needs``. There are no more positional arguments.

        Raises:
            InvalidValueError: data or environment do not fit, or ``run`` holds another run.
            SimulationDivergedError, TrainingDivergedError: something is not finite; the last checkpoint is intact.
        """
        ...
