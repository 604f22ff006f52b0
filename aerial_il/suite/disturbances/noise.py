"""Noise: slowly wandering errors of the state that the flight controller measures."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from aerial_il.core.kernels import kernel
from aerial_il.robots.robot import Robot
from aerial_il.suite.disturbances.disturbance import Disturbance, Start, Strength
from aerial_il.suite.physics.noise import gaussian

DEVIATIONS = {"position": 0.002, "velocity": 0.01, "attitude": 0.003, "rate": 0.01}  # m, m/s, rad, rad/s: of each axis
TIME_S = 0.1  # for which errors persist


@dataclass(frozen=True)
class Noise(Disturbance):
    """Errors of the state that the flight controller measures, along each axis, Gauss–Markov.

    Attributes:
        scale: multiple of their standard deviations, 2 mm, 10 mm/s, 3 mrad and 10 mrad/s.
    """

    scale: float = 1.0
    strength: ClassVar[Strength | None] = Strength("times the errors in `calm`", 0.0, 10.0)
    memory: ClassVar[int] = 12
    stream: ClassVar[int | None] = 16

    @classmethod
    def of(cls, strength: float) -> Noise:
        return cls(strength)

    def unfelt(self, robot: Robot) -> str | None:
        return f"{robot.name} stands fixed: nothing of its pose is measured in flight" if robot.fixed else None

    def numbers(self, robot: Robot) -> dict[str, float]:
        return {**{name: self.scale * value for name, value in DEVIATIONS.items()}, "time": TIME_S}

    def start(self, at: Start) -> np.ndarray:
        return at.rng.standard_normal(self.memory)


TIERS = {"calm": Noise(), "breeze": Noise(), "gusts": Noise(), "hard": Noise(1.5)}


@kernel
def advance(own, memory, now):
    """Advance the twelve errors, each of unit variance."""
    decay = math.exp(-now.dt / own.time)
    kick = math.sqrt(1.0 - decay * decay)
    seed, tick, stream = now.seed, now.tick, own.stream  # read once: the compiler cannot know that memory is elsewhere
    for k in range(12):
        memory[k] = decay * memory[k] + kick * gaussian(seed, tick, stream + k)


@kernel
def act(own, memory, now, effects):
    """Add them to the estimate."""
    for k in range(3):
        effects.position[k] += own.position * memory[k]
        effects.velocity[k] += own.velocity * memory[3 + k]
        effects.attitude[k] += own.attitude * memory[6 + k]
        effects.rate[k] += own.rate * memory[9 + k]
