"""Expert for track: fly to the target and stay with it."""

import numpy as np

from aerial_il.core.arrays import length
from aerial_il.core.kernels import kernel
from aerial_il.experts.expert import Expert, pointing_down
from aerial_il.suite.episode import measured
from aerial_il.suite.tasks import track
from aerial_il.suite.tasks.track import CAUGHT_M, LOST_M

APPROACH, FOLLOW = range(2)
LEAD_S = 0.02  # the command is flown during the next control step: aim at where the target will be at its end
NOISE_NEAR_TARGET = 0.25  # the whole perturbation is as large as the error that a lap allows
LEVEL = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)  # rot6d of a tool that looks ahead


@kernel
def _led_target(world):
    """Position of the target when the command has been flown, world frame, m."""
    return track.target_ahead(world, LEAD_S)


target_pos, led_target = measured.vector(track.target_pos), measured.vector(_led_target)


class TrackExpert(Expert):
    """Command the target itself; the reference governor plans the approach and feeds the target's speed forward."""

    phase_names = ("approach", "follow")

    def first_phase(self) -> np.ndarray:
        return np.full(self.view.n, APPROACH)

    def next_phase(self) -> np.ndarray:
        return np.where(self._distance() <= CAUGHT_M, FOLLOW, APPROACH)

    def command(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        view = self.view
        ahead = pointing_down(np.zeros(view.n)) if view.robot.num_joints else np.tile(LEVEL, (view.n, 1))
        return led_target(view), ahead, np.ones(view.n)

    def noise_share(self) -> np.ndarray:
        return np.where(self._distance() <= LOST_M, NOISE_NEAR_TARGET, 1.0)

    def _distance(self) -> np.ndarray:
        return length(target_pos(self.view) - self.view.tool_pos)


EXPERT = TrackExpert
