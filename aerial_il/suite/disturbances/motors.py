"""Motors: rotors that push more or less than commanded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from aerial_il.suite.disturbances.disturbance import Disturbance
from aerial_il.suite.disturbances.nominal import ROTOR_GAIN, Nominal, factors


@dataclass(frozen=True)
class Motors(Disturbance):
    """Rotors that push more or less than commanded.

    Attributes:
        gain: half width of the range of each rotor's thrust, as a share of the commanded one.
    """

    gain: float = 0.05
    varies: ClassVar[tuple[str, ...]] = (ROTOR_GAIN,)

    def vary(self, fields: dict[str, np.ndarray], nominal: Nominal, rng: np.random.Generator) -> dict[str, Any]:
        gains = factors(rng, self.gain, nominal.robot.num_rotors)
        fields[ROTOR_GAIN] *= gains
        return {"rotor_gain": gains}


TIERS = {"hard": Motors()}
