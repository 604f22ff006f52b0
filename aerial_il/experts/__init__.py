"""Scripted experts: one file for each task, registered by being there."""

from __future__ import annotations

from typing import TYPE_CHECKING

from aerial_il.core import registry

if TYPE_CHECKING:
    from aerial_il.experts.expert import Expert


def names() -> tuple[str, ...]:
    """Names of all tasks that have an expert."""
    return registry.names("expert")


def make(robot: str, task: str, *, noise: float = 0.0, seed: int = 0, look: bool = False) -> Expert:
    """Return the expert for a cell.

    Args:
        robot, task: registry names.
        noise: strength of the recoverable perturbation of its commands, 0 (none) to 1.
        seed: seed of that perturbation; it also depends on each episode's own seed.
        look: fly so that the robot's cameras see what comes next.

    Raises:
        UnknownNameError: unknown robot or task, or a task without an expert. CellError: the robot cannot do the task.
    """
    from aerial_il.suite import tasks

    tasks.check_cell(robot, task)
    return registry.get("expert", task)(noise=noise, seed=seed, **({"look": True} if look else {}))
