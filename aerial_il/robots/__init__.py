"""Robots: one file each: body, rotors, arm, cameras, sensors."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from aerial_il.core import registry

if TYPE_CHECKING:  # names are listed without importing a robot or MuJoCo
    from aerial_il.robots.robot import Robot


def names() -> tuple[str, ...]:
    """Names of all robots, in alphabetical order."""
    return registry.names("robot")


@cache
def get(name: str) -> Robot:
    """Return the robot called ``name``.

    Raises:
        UnknownNameError: no robot has that name.
    """
    return registry.get("robot", name)
