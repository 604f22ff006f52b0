"""Motors: rotors that push more or less than commanded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from aerial_il.robots.robot import Robot
from aerial_il.suite.disturbances.disturbance import Disturbance, Strength
from aerial_il.suite.disturbances.nominal import ROTOR_GAIN, Nominal, factors


@dataclass(frozen=True)
class Motors(Disturbance):
    """Rotors that push more or less than commanded.

    Attributes:
        gain: half width of the range of each rotor's thrust, as a share of the commanded one.
    """

    gain: float = 0.05
    strength: ClassVar[Strength | None] = Strength("of its thrust, that one rotor gives", 0.5, 1.0)
    varies: ClassVar[tuple[str, ...]] = (ROTOR_GAIN,)

    @classmethod
    def of(cls, strength: float) -> Motors:
        return WornMotor(share=strength)

    def unfelt(self, robot: Robot) -> str | None:
        return None if robot.num_rotors else f"{robot.name} has no rotors"

    def vary(self, fields: dict[str, np.ndarray], nominal: Nominal, rng: np.random.Generator) -> dict[str, Any]:
        gains = factors(rng, self.gain, nominal.robot.num_rotors)
        fields[ROTOR_GAIN] *= gains
        return {"rotor_gain": gains}


@dataclass(frozen=True)
class WornMotor(Motors):
    """One rotor, which one is drawn for each episode, that pushes less than commanded.

    Attributes:
        gain: not used. share: of the commanded thrust, that it gives.
    """

    gain: float = 0.0
    share: float = 1.0

    def vary(self, fields: dict[str, np.ndarray], nominal: Nominal, rng: np.random.Generator) -> dict[str, Any]:
        worn = int(rng.integers(nominal.robot.num_rotors))
        fields[ROTOR_GAIN][worn] *= self.share
        return {"worn_rotor": worn}


TIERS = {"hard": Motors()}
