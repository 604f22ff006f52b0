"""Expert for hovering: command the point and the heading, and let the controller do what it is for."""

import numpy as np

from aerial_il.core.arrays import length
from aerial_il.core.rotations import rot6d_from_mat
from aerial_il.experts.expert import Expert
from aerial_il.suite.tasks.hover import SETTLED_M

APPROACH, HOLD = range(2)
NOISE_WHILE_HOLDING = 0.1  # a point that wanders by centimetres is followed by leaning


class HoverExpert(Expert):
    """The base is the tool: fly to the target and stay."""

    phase_names = ("approach", "hold")

    def first_phase(self) -> np.ndarray:
        return np.full(self.view.n, APPROACH)

    def next_phase(self) -> np.ndarray:
        distance = length(self.view.site_pos("target") - self.view.base_pos)
        return np.where(distance <= SETTLED_M, HOLD, APPROACH)

    def command(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        view = self.view
        return view.site_pos("target").copy(), rot6d_from_mat(view.site_mat("target")), np.ones(view.n)

    def noise_share(self) -> np.ndarray:
        return np.where(self.phase == HOLD, NOISE_WHILE_HOLDING, 1.0)


EXPERT = HoverExpert
