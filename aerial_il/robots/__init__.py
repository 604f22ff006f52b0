"""Robots, one file each. A module in this folder that defines ``ROBOT`` is registered by being there."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING

from aerial_il.core.errors import UnknownNameError

if TYPE_CHECKING:  # names are listed without importing a robot or MuJoCo
    from aerial_il.robots.robot import Robot

_INFRASTRUCTURE = {"robot", "figures"}


@cache
def names() -> tuple[str, ...]:
    """Names of all robots, in alphabetical order."""
    return tuple(sorted(m.name for m in iter_modules(__path__) if not m.ispkg and m.name not in _INFRASTRUCTURE))


@cache
def get(name: str) -> Robot:
    """Return the robot called ``name``.

    Raises:
        UnknownNameError: no robot has that name.
    """
    if name not in names():
        raise UnknownNameError("robot", name, names(), "Run `aerial-il list` to see what each can do.")
    return import_module(f"{__name__}.{name}").ROBOT
