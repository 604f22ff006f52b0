"""Expert for the valve: put the fingers between two spokes, tow the wheel round until the valve is open."""

import numpy as np

from aerial_il.experts.hook import HookExpert
from aerial_il.suite.episode import measured
from aerial_il.suite.props.valve import GAP_M, RIM_RADIUS_M, SPOKES, VALVE_OPEN_RAD
from aerial_il.suite.tasks import rotate_valve
from aerial_il.suite.tasks.rotate_valve import TURN_RAD_S

BETWEEN_SPOKES_RAD = 2.0 * np.pi / SPOKES
BEYOND_RAD = 0.2  # how far past the mark they are sent at the end
YAW_LEAD_RAD = 0.15  # how far the heading is sent ahead, for a vehicle turns late

inserted = measured.truth(rotate_valve.inserted)


class RotateValveExpert(HookExpert):
    """A finger enters the gap behind the yellow spoke; once in a gap between spokes, it pushes from there."""

    tolerance_m = (0.02, 0.02)

    def entry(self) -> tuple[np.ndarray, np.ndarray]:
        centre, fingers = self.view.site_pos("valve"), _azimuth(self.view.tool_pos - self.view.site_pos("valve"))
        gap = _azimuth(self.view.site_pos("gap") - centre)
        nearest = gap + BETWEEN_SPOKES_RAD * np.round((fingers - gap) / BETWEEN_SPOKES_RAD)
        spoke = _around(np.where(self.hooked(), nearest, gap))
        return centre + spoke, _facing_back(spoke)

    def hooked(self) -> np.ndarray:
        return inserted(self.view)

    def ahead(self) -> tuple[np.ndarray, np.ndarray]:
        view, centre = self.view, self.view.site_pos("valve")
        touching = (view.robot.gripper.pad_height + RIM_RADIUS_M) / GAP_M
        angle, rate = view.joint("valve")
        push = np.minimum(self.push(rate / TURN_RAD_S) / GAP_M, VALVE_OPEN_RAD + BEYOND_RAD - angle)
        azimuth = _azimuth(view.tool_pos - centre)
        spoke = _azimuth(view.site_pos("gap") - centre) + 0.5 * BETWEEN_SPOKES_RAD
        to_spoke = np.mod(spoke - azimuth, BETWEEN_SPOKES_RAD)
        return centre + _around(azimuth + to_spoke - touching + push), _facing_back(_around(azimuth + YAW_LEAD_RAD))


def _azimuth(spoke: np.ndarray) -> np.ndarray:
    """(n,) direction of a vector (n, 3) from the spindle, rad."""
    return np.arctan2(spoke[:, 1], spoke[:, 0])


def _around(azimuth: np.ndarray) -> np.ndarray:
    """(n, 3) from the spindle to the circle on which the fingers push, m."""
    return GAP_M * np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)], axis=1)


def _facing_back(spoke: np.ndarray) -> np.ndarray:
    """(n,) heading against the turn of the wheel at a point ``spoke`` (n, 3) from its spindle."""
    return np.arctan2(-spoke[:, 0], spoke[:, 1])


EXPERT = RotateValveExpert
