"""Who flies where: turn ``policy=...``, ``robot=...``, ``task=...`` into a policy and its environment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import aerial_il
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.policy import Policy
from aerial_il.policies import load_policy

EXPERT = "expert"
DEFAULT_ACTION = "ee_pose"


@dataclass(frozen=True)
class Pilot:
    """A policy with the cell and the action level that it flies."""

    policy: Policy
    robot: str
    task: str
    action: str
    words: str

    def environment(self, tier: str, *, num_envs: int, threads: int) -> Any:
        """Return a batch environment for it."""
        return aerial_il.load_batch(
            self.robot, self.task, num_envs=num_envs, tier=tier, action=self.action, num_threads=threads
        )


def pilot(source: str, *, robot: str | None, task: str | None, action: str | None) -> Pilot:
    """Return the expert of a cell, or a trained policy with what it was trained on where nothing else is said.

    Args:
        source: ``expert``, or the folder of a run or a policy.
        robot, task, action: registry names; None for the policy's own.
    """
    if source == EXPERT:
        if robot is None or task is None:
            raise InvalidValueError("policy=expert needs robot=... and task=... too. See: aerial-il list")
        policy = aerial_il.expert(robot, task)
        words = f"policy=expert robot={robot} task={task}"
        return Pilot(policy, robot, task, action or DEFAULT_ACTION, words)
    policy = load_policy(source)
    spec = policy.spec
    robot, task, action = robot or spec.robot, task or spec.task, action or spec.action.level
    return Pilot(policy, robot, task, action, f"policy={source} robot={robot} task={task} action={action}")
