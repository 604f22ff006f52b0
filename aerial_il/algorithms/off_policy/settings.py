"""Groups of settings that off-policy algorithms share by composition; each algorithm states their values itself."""

from dataclasses import dataclass
from typing import Any, Literal

from aerial_il.core.checks import require_choice, require_not_negative, require_positive, require_share, require_widths
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts import critics

Strategy = Literal["future", "final"]
BY_GOAL = (
    "hindsight.goals is {} and reward {}; with hindsight each step is rewarded by the rule of its goal and by nothing "
    "else: leave algorithm.reward=environment, or set algorithm.hindsight.goals=0."
)


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


@dataclass(frozen=True, kw_only=True)
class Hindsight:
    """The other goals that episodes are stored with.

    Attributes:
        goals: how many other goals each step is stored with; 0 for no hindsight. The source's is 4.
        strategy: where they were achieved: at a random step of the same episode from then on (``future``), or at its
            ``final`` one, which is a single goal.
        tolerance: share of the goal's own tolerance that is rewarded. A policy that is rewarded at its edge comes to
            rest there, as often outside as inside; one that aims for the middle passes.
    """

    goals: int
    strategy: Strategy
    tolerance: float

    def __post_init__(self) -> None:
        require_positive(self, "tolerance")
        require_share(self, "tolerance")
        require_not_negative(self, "goals")
        require_choice(self, "strategy", Strategy)
        if self.strategy == "final" and self.goals > 1:
            raise InvalidValueError(f"goals is {self.goals}; an episode has one final goal: set goals=1.")

    def check_in(self, algorithm: Any) -> None:
        """Raise :class:`InvalidValueError` where steps are to be rewarded by another rule than that of their goal."""
        if self.goals and algorithm.reward != "environment":
            raise InvalidValueError(BY_GOAL.format(self.goals, algorithm.reward))
