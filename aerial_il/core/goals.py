"""Goals that can be exchanged after the fact: what an environment shows of them, and the value of reaching one."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import ObservationSpec

GoalReward = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class GoalSpec:
    """Which observation fields tell a goal, and what it would have paid to pursue another.

    Attributes:
        achieved: fields that tell what has been achieved. desired: fields that tell what is wanted, each of the shape
            of the achieved one at its place.
        reward: ``(achieved (m, Dg), desired (m, Dg)) -> (m,)``, what a step is paid that led to ``achieved``.
        offsets: fields that show a desired field minus another, ``name -> (desired, other)``.
        within: the same as ``reward`` with the share of its tolerance that is let pass; None where it has none.
    """

    achieved: tuple[str, ...]
    desired: tuple[str, ...]
    reward: GoalReward
    offsets: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    within: Callable[[np.ndarray, np.ndarray, float], np.ndarray] | None = None

    def check(self, spec: ObservationSpec) -> None:
        """Raise :class:`InvalidValueError` unless the fields of ``spec`` are as the goal says."""
        shapes = [[spec[name].shape for name in names] for names in (self.achieved, self.desired)]
        if not self.achieved or shapes[0] != shapes[1]:
            raise InvalidValueError(
                f"A goal's fields differ: {self.achieved} show {shapes[0]}, {self.desired} {shapes[1]}."
            )

    @property
    def fields(self) -> tuple[str, ...]:
        """All fields that change or decide when another goal is put in."""
        return (*self.achieved, *self.desired, *self.offsets, *(other for _, other in self.offsets.values()))


class GoalColumns:
    """A goal within frames (T, Do), observations laid out in columns.

    Args:
        goal: of the environment. columns: ``name -> slice`` of a frame, for every field that is shown.

    Raises:
        InvalidValueError: a field of the goal is not shown.
    """

    def __init__(self, goal: GoalSpec, columns: Mapping[str, slice]) -> None:
        if missing := sorted({*goal.fields} - {*columns}):
            hint = "Leave them out of policy.masked_fields, or name them in policy.obs_names."
            raise InvalidValueError(f"Hindsight exchanges goals, and {', '.join(missing)} is not shown. {hint}")
        self._goal, self._columns = goal, columns

    def achieved(self, frames: np.ndarray) -> np.ndarray:
        """Return what frames (T, Do) tell to have been achieved, (T, Dg)."""
        return np.concatenate([frames[:, self._columns[name]] for name in self._goal.achieved], axis=1)

    def desired(self, frames: np.ndarray) -> np.ndarray:
        """Return what is wanted in frames (T, Do), (T, Dg)."""
        return np.concatenate([frames[:, self._columns[name]] for name in self._goal.desired], axis=1)

    def exchanged(self, frames: np.ndarray, goals: np.ndarray) -> np.ndarray:
        """Return frames (T, Do) in which ``goals`` (T, Dg) are wanted."""
        exchanged, at = frames.copy(), 0
        for name in self._goal.desired:
            columns = self._columns[name]
            width = columns.stop - columns.start
            exchanged[:, columns] = goals[:, at : at + width]
            at += width
        for name, (wanted, other) in self._goal.offsets.items():
            exchanged[:, self._columns[name]] = exchanged[:, self._columns[wanted]] - exchanged[:, self._columns[other]]
        return exchanged

    def rewards(self, next_frames: np.ndarray, *, tolerance: float = 1.0) -> np.ndarray:
        """Return what the steps that led to ``next_frames`` (T, Do) are paid, (T,).

        Args:
            tolerance: share of what the goal lets pass.

        Raises:
            InvalidValueError: the goal has no tolerance that could be another.
        """
        achieved, desired = self.achieved(next_frames), self.desired(next_frames)
        if tolerance == 1.0:
            return np.asarray(self._goal.reward(achieved, desired), float)
        if self._goal.within is None:
            raise InvalidValueError(f"The rule of this goal is its own: tolerance is {tolerance:g}; it must be 1.")
        return np.asarray(self._goal.within(achieved, desired, tolerance), float)
