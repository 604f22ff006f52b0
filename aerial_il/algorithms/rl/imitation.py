"""Settings of algorithms that imitate transitions of demonstrations, and the controls that take them away."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar, Literal

from aerial_il.algorithms.online.demonstrations import Labels, check_same, random_transitions, read_transitions
from aerial_il.algorithms.online.interface import Bounds, fit_interface
from aerial_il.algorithms.online.problem import Problem
from aerial_il.algorithms.rl.algorithm import OnlineAlgorithm
from aerial_il.algorithms.run.checks import require_choice, require_positive
from aerial_il.core.contracts import BatchEnv
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.network import PolicySettings

Control = Literal["none", "random_actions", "constant_reward"]


@dataclass(frozen=True, kw_only=True)
class Imitation(OnlineAlgorithm):
    """Settings of imitation; stands before :class:`OffPolicy` or :class:`OnPolicy` among the bases.

    Attributes:
        trajectories: how many demonstrations, the first ones; None for all.
        subsample: keep one step of the demonstrations in so many.
        bounds: what actions of ±1 stand for, the ``environment``'s bounds or the range of the ``demonstrations``.
        labels: what counts as the demonstrator's action where it was perturbed: what was ``executed``, or what the
            ``expert`` meant, which shows how to recover.
        control: ``none``, or what stands in for demonstrations: ``random_actions`` or ``constant_reward``.
        absorbing: whether terminal steps lead to an absorbing state; otherwise the value after them is zero.
    """

    rewarded: ClassVar[bool] = False
    demonstrated: ClassVar[bool] = True

    trajectories: int | None = None
    subsample: int = 1
    bounds: Bounds = "environment"
    labels: Labels = "executed"
    control: Control = "none"
    absorbing: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "subsample")
        if self.trajectories is not None:
            require_positive(self, "trajectories")
        require_choice(self, "bounds", Bounds)
        require_choice(self, "labels", Labels)
        require_choice(self, "control", Control)

    @property
    def learns_from_failures(self) -> bool:
        """Whether failed episodes are learned from too: none is imitated."""
        return False

    def problem(self, dataset: Iterable[Episode] | None, policy: PolicySettings, env: BatchEnv, seed: int) -> Problem:
        """Read the demonstrations; in the control run ``random_actions``, fly at random in their place."""
        layout, demos, record = read_transitions(
            dataset or (),
            policy,
            trajectories=self.trajectories,
            subsample=self.subsample,
            labels=self.labels,
            rewarded=self.rewarded,
            failures=self.learns_from_failures,
            smoothness=self.scheme.smoothness,
            seed=seed,
        )
        check_same(layout.spec, env.spec)
        if self.control == "random_actions":
            demos = random_transitions(env, layout, len(demos.frames), seed=seed, scheme=self.scheme)
        interface = fit_interface(layout, demos.frames, demos.actions, policy=policy, bounds=self.bounds)
        return Problem(self.name, seed, policy, env, interface, demos, record, self.scheme)
