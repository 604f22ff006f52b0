"""Groups of settings that off-policy algorithms share by composition; each algorithm states their values itself."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal, Protocol

from aerial_il.algorithms.rl.collector import RewardScheme
from aerial_il.algorithms.rl.interface import Bounds
from aerial_il.algorithms.rl.replay.demonstrations import Labels
from aerial_il.algorithms.rl.replay.hindsight import Hindsight
from aerial_il.algorithms.rl.smoothness import Smoothness
from aerial_il.algorithms.run.algorithm import Cadence
from aerial_il.algorithms.run.checks import (
    require_choice,
    require_positive,
    require_share,
    require_widths,
)
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts import critics

Source = Literal["environment", "sparse"]
Control = Literal["none", "random_actions"]


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


class Rewarded(Protocol):
    """What decides how steps are rewarded."""

    demonstrated: ClassVar[bool]

    @property
    def reward(self) -> Source: ...
    @property
    def hindsight(self) -> Hindsight: ...
    @property
    def smoothness(self) -> Smoothness: ...
    @property
    def cadence(self) -> Cadence: ...


def reward_scheme(settings: Rewarded) -> RewardScheme:
    """Return how steps are rewarded, with advice for where no reward comes."""
    if settings.hindsight.goals and settings.reward != "environment":
        raise InvalidValueError(BY_GOAL.format(settings.hindsight.goals, settings.reward))
    advice, patience = f"Ways out: {'; '.join(_ways_out(settings))}.", settings.cadence.reward_patience
    sparse = settings.reward == "sparse"
    return RewardScheme(sparse=sparse, smoothness=settings.smoothness, patience=patience, advice=advice)


def _ways_out(settings: Rewarded) -> Iterator[str]:
    begin = "an algorithm that begins with demonstrations (algorithm=bc_ppo dataset=PATH)"
    yield "more demonstrations, or a better prior" if settings.demonstrated else begin
    if settings.reward == "sparse":
        yield "a dense reward (algorithm.reward=environment)"
    if not settings.hindsight.goals:
        yield "hindsight, where the task exposes a goal (algorithm.hindsight.goals=4)"


@dataclass(frozen=True, kw_only=True)
class Prior:
    """A trained policy that the actor starts from; it flies through the warm-up while critics learn its value.

    Attributes:
        path: a run or policy of the same class and sizes.
    """

    path: str


@dataclass(frozen=True, kw_only=True)
class Demonstrations:
    """Which demonstrations are learned from, and how.

    Attributes:
        trajectories: how many, the first ones; null for all.
        subsample: keep one step in so many.
        bounds: what actions of ±1 stand for, the ``environment``'s bounds or the range of the ``demonstrations``.
        labels: what counts as their action: what was ``executed``; critics would learn values of actions that nobody
            took from what the ``expert`` meant.
        failures: learn from failed episodes too.
        absorbing: whether success that ends an episode leads to an absorbing state with its reward.
        control: ``none``, or ``random_actions`` in their place.
    """

    trajectories: int | None
    subsample: int
    bounds: Bounds
    labels: Labels
    failures: bool
    absorbing: bool
    control: Control

    def __post_init__(self) -> None:
        require_positive(self, "subsample", *(["trajectories"] if self.trajectories is not None else []))
        require_choice(self, "bounds", Bounds)
        require_choice(self, "labels", Labels)
        require_choice(self, "control", Control)


BY_GOAL = (
    "hindsight.goals is {} and reward {}; with hindsight each step is rewarded by the rule of its goal and by "
    "nothing else: leave algorithm.reward=environment, or set algorithm.hindsight.goals=0."
)
