"""Pilots of the bare quadrotor: a flight law that is given the target, or a policy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

import aerial_il
from aerial_il.control import controller_state
from aerial_il.core.contracts import Policy
from aerial_il.suite.batch import BatchEnvironment

ROBOT, TASK = "quad", "hover"


class Pilot(Protocol):
    """Flies any number of worlds of ``hover``."""

    @property
    def label(self) -> str:
        """What tells it from others, a file name."""
        ...

    def environment(self, tier: str, num_envs: int, steps: int, *, threads: int) -> BatchEnvironment:
        """Return worlds that it can fly, over ``steps`` steps that success does not end."""
        ...

    def policy(self) -> Policy:
        """Return what acts in them."""
        ...

    def retarget(self, env: BatchEnvironment) -> None:
        """Take note that the target has jumped."""
        ...


@dataclass(frozen=True)
class LawPilot:
    """A flight law whose reference is the target itself.

    Attributes:
        law: its registry name.
    """

    law: str

    @property
    def label(self) -> str:
        return self.law

    def environment(self, tier: str, num_envs: int, steps: int, *, threads: int) -> BatchEnvironment:
        return aerial_il.load_batch(
            ROBOT, TASK, num_envs=num_envs, tier=tier, action="base_joint", controller=self.law, horizon=steps,
            num_threads=threads,
        )  # fmt: skip

    def policy(self) -> Policy:
        return ToTarget()

    def retarget(self, env: BatchEnvironment) -> None:
        """Let the reference jump, too: the planner would only let it travel there, and hide what the law does."""
        view = env.simulation.view
        target = view.site_mat("target")
        at = controller_state.BASE_POS
        view.userdata[:, at : at + 3] = view.site_pos("target")
        view.userdata[:, controller_state.BASE_YAW] = np.arctan2(target[:, 3], target[:, 0])


class ToTarget:
    """Commands the base to the target: (n, 4), position (m) and heading (rad)."""

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Nothing is remembered."""

    def act(self, obs: Mapping[str, np.ndarray]) -> np.ndarray:
        heading = obs["target_heading"]
        return np.column_stack([obs["target_pos"], np.arctan2(heading[:, 1], heading[:, 0])])


@dataclass(frozen=True, eq=False)
class PolicyPilot:
    """A learned policy.

    Attributes:
        learned: the policy. action: level of its actions. label: what tells it from others.
    """

    learned: Policy
    action: str
    label: str

    def environment(self, tier: str, num_envs: int, steps: int, *, threads: int) -> BatchEnvironment:
        return aerial_il.load_batch(
            ROBOT, TASK, num_envs=num_envs, tier=tier, action=self.action, horizon=steps, num_threads=threads
        )

    def policy(self) -> Policy:
        return self.learned

    def retarget(self, env: BatchEnvironment) -> None:
        """It sees the target in its observation."""
