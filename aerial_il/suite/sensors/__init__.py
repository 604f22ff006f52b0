"""Sensors, one file each: what a robot knows of itself, see ``sensor.py``. A robot lists those that it has."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from aerial_il.core import registry

if TYPE_CHECKING:  # names are listed without importing a compiler
    from aerial_il.core.specs import Field
    from aerial_il.robots.robot import Robot
    from aerial_il.suite.sensors.sensor import Sensor


def of(robot: Robot) -> Iterator[tuple[str, Sensor, tuple[Field, ...]]]:
    """Yield name, settings and fields of the sensors that have something to show on a robot, in its order."""
    for name, settings in robot.sensors.items():
        sensor: Sensor = registry.get("sensor", name)(**settings)
        if fields := sensor.fields(robot):
            yield name, sensor, fields


def robot_fields(robot: Robot) -> tuple[Field, ...]:
    """Return what a robot shows of itself: the fields of its sensors, in their order."""
    return tuple(field for _, _, fields in of(robot) for field in fields)
