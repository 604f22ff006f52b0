"""Tasks, one file each. A module in this folder that defines ``TASK`` is registered by being there."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

from aerial_il import robots
from aerial_il.core import registry
from aerial_il.core.errors import AerialError, InvalidValueError, UnknownNameError

if TYPE_CHECKING:  # names are listed without importing a task or MuJoCo
    from aerial_il.robots.robot import Robot
    from aerial_il.suite.tasks.task import Task


class CellError(AerialError, ValueError):
    """A robot asked to do a task it cannot do."""


def names() -> tuple[str, ...]:
    """Names of all tasks, in alphabetical order."""
    return registry.names("task")


@cache
def get(name: str) -> Task:
    """Return the task called ``name``.

    Raises:
        UnknownNameError: no task has that name.
    """
    return registry.get("task", name)


@cache
def cells() -> tuple[tuple[str, str], ...]:
    """All supported (robot, task) pairs.

    Raises:
        UnknownNameError, InvalidValueError: a robot cannot decline what its file says, see :func:`check_declines`.
    """
    for robot in robots.readable():
        check_declines(robots.get(robot))
    return tuple((r, t) for r in robots.readable() for t in names() if get(t).infeasibility(robots.get(r)) is None)


def check_declines(robot: Robot) -> None:
    """Refuse entries of a robot's ``declines`` that cannot be meant.

    Raises:
        UnknownNameError: there is no such task.
        InvalidValueError: a task's own rules say it already, or nothing is left that the robot would do.
    """
    if not robot.declines:
        return
    for task in robot.declines:
        if task not in names():
            raise UnknownNameError(f"task among those that {robot.name} declines:", task, names())
    rest = replace(robot, declines={})
    able = {task for task in names() if get(task).infeasibility(rest) is None}
    if superfluous := sorted(robot.declines.keys() - able):
        raise InvalidValueError(f"{robot.name} declines {superfluous[0]}, which its rules decline; remove the line.")
    if able and not able - robot.declines.keys():
        raise InvalidValueError(f"{robot.name} declines every task that it could do: {', '.join(sorted(able))}.")


def check_cell(robot: str, task: str) -> None:
    """Refuse a pair that is not supported.

    Raises:
        UnknownNameError: no such robot or task.
        CellError: the robot cannot do the task; the message says why and which robots can.
    """
    infeasibility = get(task).infeasibility(robots.get(robot))
    check_declines(robots.get(robot))
    if infeasibility is not None:
        able = ", ".join(r for r, t in cells() if t == task)
        raise CellError(f"{robot} cannot do {task}: {infeasibility}. Robots that can: {able}.")
