"""Expert for reach: command the target pose and wait there."""

import numpy as np

from aerial_il.core.arrays import length
from aerial_il.core.rotations import rot6d_from_mat
from aerial_il.experts.expert import Expert

APPROACH, HOLD = range(2)
ARRIVED_M = 0.02


class ReachExpert(Expert):
    """Fly to the target; the reference governor generates the path."""

    phase_names = ("approach", "hold")
    travels = (APPROACH,)

    def first_phase(self) -> np.ndarray:
        return np.full(self.view.n, APPROACH)

    def next_phase(self) -> np.ndarray:
        distance = length(self.view.site_pos("target") - self.view.tool_pos)
        return np.where(distance <= ARRIVED_M, HOLD, APPROACH)

    def command(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        view = self.view
        return view.site_pos("target").copy(), rot6d_from_mat(view.site_mat("target")), np.ones(view.n)


EXPERT = ReachExpert
