"""Camera tilt: cameras that look a little past what they looked at when demonstrations were seen through them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from aerial_il.robots.robot import Robot
from aerial_il.suite.disturbances.disturbance import Disturbance, Strength
from aerial_il.suite.disturbances.nominal import CAMERA_TURN, Nominal


@dataclass(frozen=True)
class CameraTilt(Disturbance):
    """Cameras of the robot that are turned for a whole episode, each about an axis that is drawn for it.

    Attributes:
        angle: degrees.
    """

    angle: float = 3.0
    strength: ClassVar[Strength | None] = Strength("degrees, by which each camera of the robot is turned", 0.0, 30.0)
    varies: ClassVar[tuple[str, ...]] = (CAMERA_TURN,)

    @classmethod
    def of(cls, strength: float) -> CameraTilt:
        return cls(strength)

    def unfelt(self, robot: Robot) -> str | None:
        return None if robot.mounted_cameras else f"{robot.name} has no cameras"

    def vary(self, fields: dict[str, np.ndarray], nominal: Nominal, rng: np.random.Generator) -> dict[str, Any]:
        axis = rng.standard_normal(fields[CAMERA_TURN].shape)
        fields[CAMERA_TURN] += np.radians(self.angle) * axis / np.linalg.norm(axis, axis=1, keepdims=True)
        return {}


TIERS: dict[str, CameraTilt] = {}
