"""Camera shift: cameras that are not quite where they were when demonstrations were seen through them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from aerial_il.robots.robot import Robot
from aerial_il.suite.disturbances.disturbance import Disturbance, Strength
from aerial_il.suite.disturbances.nominal import CAMERA_OFFSET, Nominal


@dataclass(frozen=True)
class CameraShift(Disturbance):
    """Cameras of the robot that are displaced for a whole episode, each in a direction that is drawn for it.

    Attributes:
        distance: m.
    """

    distance: float = 0.02
    strength: ClassVar[Strength | None] = Strength("m, by which each camera of the robot is displaced", 0.0, 0.2)
    varies: ClassVar[tuple[str, ...]] = (CAMERA_OFFSET,)

    @classmethod
    def of(cls, strength: float) -> CameraShift:
        return cls(strength)

    def unfelt(self, robot: Robot) -> str | None:
        return None if robot.mounted_cameras else f"{robot.name} has no cameras"

    def vary(self, fields: dict[str, np.ndarray], nominal: Nominal, rng: np.random.Generator) -> dict[str, Any]:
        way = rng.standard_normal(fields[CAMERA_OFFSET].shape)
        fields[CAMERA_OFFSET] += self.distance * way / np.linalg.norm(way, axis=1, keepdims=True)
        return {}


TIERS: dict[str, CameraShift] = {}
