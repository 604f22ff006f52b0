"""Expert for the door: go down into the handle, pull the door open along its arc."""

from typing import ClassVar

import numpy as np

from aerial_il.experts.hook import HookExpert
from aerial_il.suite.episode import measured
from aerial_il.suite.props.door import BAR_RADIUS_M, HINGE_TO_LOOP_M, LOOP_M
from aerial_il.suite.tasks import open_door
from aerial_il.suite.tasks.open_door import OPEN_RAD, SWING_RAD_S

YAW_LEAD_RAD = 0.15  # how far the heading is sent ahead, for a vehicle turns late
BEYOND_RAD = 0.2  # how far past what is asked it is pulled at the end

hooked = measured.truth(open_door.hooked)


class OpenDoorExpert(HookExpert):
    """The tool faces the door and turns with it."""

    tolerance_m = (0.015, 0.03)
    open_rad: ClassVar[float] = OPEN_RAD

    def entry(self) -> tuple[np.ndarray, np.ndarray]:
        return self.view.site_pos("loop").copy(), self._heading()

    def hooked(self) -> np.ndarray:
        return hooked(self.view)

    def ahead(self) -> tuple[np.ndarray, np.ndarray]:
        view = self.view
        angle, rate = view.joint("door")
        push = np.minimum(self.push(rate / SWING_RAD_S), (self.open_rad + BEYOND_RAD - angle) * HINGE_TO_LOOP_M)
        touching = 0.5 * LOOP_M - 1.5 * BAR_RADIUS_M - view.robot.gripper.pad_height
        out = view.site_mat("loop")[:, [0, 3, 6]]
        return view.site_pos("loop") + (touching + push)[:, None] * out, self._heading() + YAW_LEAD_RAD

    def _heading(self) -> np.ndarray:
        """(n,) heading into the door, rad."""
        mat = self.view.site_mat("loop")
        return np.arctan2(-mat[:, 3], -mat[:, 0])


EXPERT = OpenDoorExpert
