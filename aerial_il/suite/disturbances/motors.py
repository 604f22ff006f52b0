"""Motors: rotors that push more or less than commanded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from aerial_il.suite.disturbances.disturbance import Disturbance
from aerial_il.suite.disturbances.nominal import Nominal, factors


@dataclass(frozen=True)
class Motors(Disturbance):
    """Rotors that push more or less than commanded.

    Attributes:
        gain: half width of the range of each rotor's thrust, as a share of the commanded one.
    """

    gain: float = 0.05
    varies: ClassVar[tuple[str, ...]] = ("actuator_gainprm",)

    def vary(self, fields: dict[str, np.ndarray], nominal: Nominal, rng: np.random.Generator) -> dict[str, Any]:
        rotors = nominal.robot.num_rotors
        gains = factors(rng, self.gain, rotors)
        fields["actuator_gainprm"][:rotors, 0] *= gains
        return {"rotor_gain": gains}


TIERS = {"hard": Motors()}
