"""Groups of settings that off-policy algorithms share by composition; each algorithm states their values itself."""

from __future__ import annotations

from dataclasses import dataclass

from aerial_il.core.checks import require_positive, require_share, require_widths
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts import critics


@dataclass(frozen=True, kw_only=True)
class Replay:
    """The replay buffer, and how much is learned from it.

    Attributes:
        capacity: transitions kept.
        batch_size: transitions in a minibatch.
        updates_per_step: gradient steps of the critics for each environment step (update-to-data ratio).
    """

    capacity: int
    batch_size: int
    updates_per_step: float

    def __post_init__(self) -> None:
        require_positive(self, "capacity", "batch_size", "updates_per_step")


@dataclass(frozen=True, kw_only=True)
class Critics:
    """The action-value critics and their targets.

    Attributes:
        count: how many there are.
        hidden: widths of each.
        layer_norm: standardise each hidden layer, which bounds the values of actions that were never tried
            (P. Ball et al. 2023, section 4.2).
        tau: share by which target networks follow at each update (Polyak averaging).
    """

    count: int
    hidden: tuple[int, ...]
    layer_norm: bool
    tau: float

    def __post_init__(self) -> None:
        require_positive(self, "count", "tau")
        require_share(self, "tau")
        require_widths(self, "hidden")

    def build(self, sizes: tuple[int, int]) -> critics.Critics:
        """Return new critics for observations and actions of these ``sizes``; one input is for the absorbing state."""
        return critics.Critics(sizes[0] + 1 + sizes[1], self.hidden, self.count, layer_norm=self.layer_norm)

    def check_subset(self, subset: int) -> None:
        """Raise :class:`InvalidValueError` unless there are ``subset`` critics to sample for each backup."""
        if not 0 < subset <= self.count:
            raise InvalidValueError(f"subset is {subset}; it must lie between 1 and critics.count, {self.count}.")
