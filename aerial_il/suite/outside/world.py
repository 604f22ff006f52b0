"""Contract of one world of an environment from outside, to be stepped in a batch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from aerial_il.core.goals import GoalSpec
from aerial_il.core.specs import ActionSpec, ObservationSpec


@dataclass(frozen=True)
class Outcome:
    """Answer of one world.

    Attributes:
        obs: ``name -> (*shape)``. reward: as the environment gives it. terminated: it ended by itself.
        truncated: it ran out of time by its own clock. info: whatever it reports.
    """

    obs: dict[str, np.ndarray]
    reward: float = 0.0
    terminated: bool = False
    truncated: bool = False
    info: Mapping[str, Any] = field(default_factory=dict)


class World(Protocol):
    """One environment behind names, flat arrays and seeds.

    Attributes:
        observation, action: what it shows and takes. control_dt_s: time between two actions, s. max_steps: its own time
            limit, None for none. goal_spec: what can be exchanged after the fact, or None.
    """

    observation: ObservationSpec
    action: ActionSpec
    control_dt_s: float
    max_steps: int | None
    goal_spec: GoalSpec | None

    def reset(self, seed: int) -> Outcome:
        """Start the episode of ``seed``, always the same one."""
        ...

    def executed(self, action: np.ndarray) -> np.ndarray:
        """Return what an action (Da,) within the bounds becomes when it is executed, (Da,)."""
        ...

    def step(self, action: np.ndarray) -> Outcome:
        """Take an executed action (Da,)."""
        ...

    def observe(self) -> dict[str, np.ndarray]:
        """Return what the world shows after its physics was set from outside.

        Raises:
            InvalidValueError: the environment cannot be asked without a step.
        """
        ...

    def physics(self) -> tuple[Any, Any] | None:
        """Return MuJoCo's model and data behind the world, or None."""
        ...

    def close(self) -> None:
        """Free what the environment holds."""
        ...
