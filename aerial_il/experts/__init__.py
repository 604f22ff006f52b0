"""Scripted experts, one file per task. A module in this folder that defines ``EXPERT`` is registered by being there."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from aerial_il.core.errors import UnknownNameError
from aerial_il.experts.expert import Expert
from aerial_il.suite import tasks

_INFRASTRUCTURE = {"expert", "hook"}


@cache
def names() -> tuple[str, ...]:
    """Names of all tasks that have an expert."""
    return tuple(sorted(m.name for m in iter_modules(__path__) if not m.ispkg and m.name not in _INFRASTRUCTURE))


def make(robot: str, task: str, *, noise: float = 0.0, seed: int = 0) -> Expert:
    """Return the expert for a cell.

    Args:
        robot, task: registry names.
        noise: strength of the recoverable perturbation of its commands, 0 (none) to 1.
        seed: seed of that perturbation; it also depends on each episode's own seed.

    Raises:
        UnknownNameError: unknown robot or task, or a task without an expert. CellError: the robot cannot do the task.
    """
    tasks.check_cell(robot, task)
    if task not in names():
        raise UnknownNameError("expert", task, names())
    return import_module(f"{__name__}.{task}").EXPERT(noise=noise, seed=seed)
