"""Squall: once in an episode, a blast of wind that swells, holds and dies away, from anywhere."""

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from aerial_il.control.vehicle import GRAVITY
from aerial_il.core.kernels import kernel
from aerial_il.robots.robot import Robot
from aerial_il.suite.disturbances.disturbance import Disturbance, Start
from aerial_il.suite.physics.aerodynamics import quadratic_drag

AGE, BEGINS, DIRECTION = range(3)  # s since the start, s, and where it blows to, rad


@dataclass(frozen=True)
class Squall(Disturbance):
    """One blast of wind in an episode.

    Attributes:
        share: its drag on the level vehicle, as a share of the weight. rise: s in which it swells, and dies away.
        hold: s in between. latest: s after the start, at which it begins.
    """

    share: float = 0.1
    rise: float = 0.2
    hold: float = 1.5
    latest: float = 4.0
    memory: ClassVar[int] = 3

    def numbers(self, robot: Robot) -> dict[str, float]:
        vehicle = robot.vehicle
        a, b, c = quadratic_drag(vehicle), 0.5 * float(vehicle.drag[:2].sum()), self.share * vehicle.mass * GRAVITY
        speed = (math.sqrt(b * b + 4.0 * a * c) - b) / (2.0 * a) if a else 0.0  # drag is a v² + b v
        return {"speed": speed, "rise": self.rise, "hold": self.hold}

    def start(self, at: Start) -> np.ndarray:
        return np.array([0.0, at.rng.uniform(0.0, self.latest), at.rng.uniform(-math.pi, math.pi)])

    def drawn(self, memory: np.ndarray) -> dict[str, Any]:
        return {"squall_begins_s": float(memory[BEGINS]), "squall_direction_rad": float(memory[DIRECTION])}


@kernel
def advance(own, memory, now):
    memory[AGE] += now.dt


@kernel
def act(own, memory, now, effects):
    since = memory[AGE] - memory[BEGINS]
    left = 2.0 * own.rise + own.hold - since
    share = min(1.0, max(0.0, min(since, left) / own.rise))
    effects.wind[0] += share * own.speed * math.cos(memory[DIRECTION])
    effects.wind[1] += share * own.speed * math.sin(memory[DIRECTION])
