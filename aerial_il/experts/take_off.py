"""Expert for taking off: straight up out of the ground's reach, then to the point."""

import numpy as np

from aerial_il.core.arrays import length
from aerial_il.core.rotations import rot6d_from_mat
from aerial_il.experts.expert import Expert
from aerial_il.experts.hover import NOISE_WHILE_HOLDING
from aerial_il.suite.props.skids import STAND_M
from aerial_il.suite.tasks.hover import SETTLED_M

RISE, APPROACH, HOLD = range(3)
CLEAR_M = 0.3  # above which it no longer matters what is below


class TakeOffExpert(Expert):
    """Rise vertically, so that no skid is dragged along the ground, then fly to the target and stay."""

    phase_names = ("rise", "approach", "hold")

    def first_phase(self) -> np.ndarray:
        return np.where(self._height() < CLEAR_M, RISE, APPROACH)

    def next_phase(self) -> np.ndarray:
        distance = length(self.view.site_pos("target") - self.view.base_pos)
        flying = np.where(distance <= SETTLED_M, HOLD, APPROACH)
        return np.where(self._height() < CLEAR_M, RISE, flying)

    def command(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        view, target = self.view, self.view.site_pos("target").copy()
        rising = self.phase == RISE
        target[rising, :2] = view.base_pos[rising, :2]
        return target, rot6d_from_mat(view.site_mat("target")), np.ones(view.n)

    def noise_share(self) -> np.ndarray:
        return np.where(self.phase == HOLD, NOISE_WHILE_HOLDING, np.where(self.phase == RISE, 0.0, 1.0))

    def _height(self) -> np.ndarray:
        """(n,) of the skids above the ground, m."""
        return self.view.base_pos[:, 2] - STAND_M


EXPERT = TakeOffExpert
