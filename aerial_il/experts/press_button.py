"""Expert for pressing a button: stand off over it, come down along its axis, push until it is in."""

import numpy as np

from aerial_il.control.vehicle import GRAVITY, Gains
from aerial_il.core.arrays import length
from aerial_il.experts.expert import Expert, facing
from aerial_il.robots.robot import Robot
from aerial_il.suite.props.button import FULL_FORCE_N, TRAVEL_M

APPROACH, PRESS = range(2)

STAND_OFF_M = 0.06  # of the fingertips over the cap
ARRIVED_M = 0.03  # how close to the stand-off the press may begin
ALIGNED_M, ALIGNED_COS = 0.015, np.cos(np.deg2rad(12.0))  # sideways error and angle from the axis at that moment
LOST_ALIGNMENT_M = 0.035
AIM_M = 0.65 * TRAVEL_M  # travel to hold: beyond what success asks for, short of the stop
NOISE_WHILE_PRESSING = 0.2  # the button may never feel more than 15 N
TOUCH_N = 0.2


class PressButtonExpert(Expert):
    """The tool is commanded to just short of the cap's stop; a vehicle that the spring would push away, deeper."""

    phase_names = ("approach", "press")
    travels = (APPROACH,)

    def first_phase(self) -> np.ndarray:
        return np.full(self.view.n, APPROACH)

    def next_phase(self) -> np.ndarray:
        height, sideways = self._offset()
        over = (sideways <= ALIGNED_M) & (height <= STAND_OFF_M + ARRIVED_M) & self._aligned()
        begin = (self.phase == APPROACH) & over
        give_up = (self.phase == PRESS) & (sideways > LOST_ALIGNMENT_M)
        return np.where(begin, PRESS, np.where(give_up, APPROACH, self.phase))

    def command(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        view = self.view
        rot6d, axis = facing(view.site_mat("button"))
        travel, _ = view.joint("button")
        lean = np.where(length(view.force()) >= TOUCH_N, lean_on(FULL_FORCE_N, view.robot), 0.0)
        depth = np.where(self.phase == PRESS, AIM_M - travel + lean, -STAND_OFF_M)
        beyond_tool = depth - view.robot.gripper.tip_distance
        return view.site_pos("button") - beyond_tool[:, None] * axis, rot6d, np.zeros(view.n)

    def noise_share(self) -> np.ndarray:
        return np.where(self.phase == PRESS, NOISE_WHILE_PRESSING, 1.0)

    def _offset(self) -> tuple[np.ndarray, np.ndarray]:
        """(n,) height of the fingertips over the cap along its axis, and their distance from the axis, m."""
        view = self.view
        _, axis = facing(view.site_mat("button"))
        ahead = view.tip_pos - view.site_pos("button")
        height = ahead[:, 0] * axis[:, 0] + ahead[:, 1] * axis[:, 1] + ahead[:, 2] * axis[:, 2]
        return height, length(ahead - height[:, None] * axis)

    def _aligned(self) -> np.ndarray:
        _, axis = facing(self.view.site_mat("button"))
        pointing = self.view.tool_mat[:, [0, 3, 6]]
        return -(pointing[:, 0] * axis[:, 0] + pointing[:, 1] * axis[:, 1] + pointing[:, 2] * axis[:, 2]) >= ALIGNED_COS


def lean_on(force: float, robot: Robot) -> float:
    """Distance beyond a surface to send the tool of ``robot`` to press with ``force`` N although its base gives way, m.

    The disturbance observer takes over a share of the weight; the rest is the position loop's, in proportion.
    """
    gains, mass = Gains().fitted(robot.vehicle), robot.vehicle.mass
    return max(0.0, force - gains.observer_limit * mass * GRAVITY) / (gains.position * mass)


EXPERT = PressButtonExpert
