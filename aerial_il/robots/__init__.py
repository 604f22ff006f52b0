"""Robots: one file each: body, rotors, arm, cameras, sensors."""

from __future__ import annotations

import logging
from functools import cache
from typing import TYPE_CHECKING

from aerial_il.core import registry
from aerial_il.core.errors import AerialError

if TYPE_CHECKING:  # names are listed without importing a robot or MuJoCo
    from aerial_il.robots.robot import Robot

log = logging.getLogger(__name__)


def names() -> tuple[str, ...]:
    """Names of all robots, in alphabetical order."""
    return registry.names("robot")


def readable() -> tuple[str, ...]:
    """Names of the robots whose files can be read."""
    return tuple(name for name in names() if is_readable(name))


@cache
def is_readable(name: str) -> bool:
    """Whether a robot's file can be read; where not it is said once why."""
    try:
        get(name)
    except AerialError as error:
        log.warning("%s", error)
        return False
    return True


@cache
def get(name: str) -> Robot:
    """Return the robot called ``name``.

    Raises:
        UnknownNameError: no robot has that name.
    """
    return registry.get("robot", name)
