"""Base class of experts that move a hinged thing: the closed fingers are a hook that goes in from above.

A hook holds whatever pulls on it, needs no grip force, and leaves the vehicle free to rise, sink and turn a little in
the wind. The tool points down and faces the way the thing resists: a vehicle that tows is never turned about its own
axis by what it tows.
"""

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from aerial_il.core.arrays import planar_length
from aerial_il.experts.expert import Expert, pointing_down
from aerial_il.robots.parts.gripper import Gripper

HOVER, DESCEND, PULL = range(3)

CRUISE_M = 0.12  # fingertips above the hook's depth while travelling
CLEAR_M = 0.06  # fingertips above it from which nothing is in the way sideways
APART_M = 0.06  # farther than this from where it goes in it first rises, then travels
LOST_ALIGNMENT = 2.0  # times the tolerance: it goes back up
PALM_SHARE = 0.85  # of a finger: with its tips this far below a bar the palm may be caught under it
BESIDE_M = 0.12  # while it is this near to the bar
PALM_TOLERANCE = 0.5  # share of the tolerance within which it comes up again
DESCENT_LEAD_M = 0.08  # how far ahead of itself the tool is sent while it goes down
NOISE_WHEN_LOW = 0.3  # share of the perturbation that fingers between bars can take
TURN_LEAD_RAD = 0.25  # a commanded heading is at most this far ahead of the tool's: yaw is what vehicles are weakest in
PUSH_M = 0.02  # how far into what it moves a hook is sent at the wanted speed: what it takes to overcome friction
PUSH_MORE_M, PUSH_MORE_M_KG = 0.015, 0.002  # more at rest: metres, at most that per kg, for light vehicles sway sooner
TIP_M, TIP_SHARE = 0.018, 0.36  # fingertips below the bar they hook: metres, at most that share of a finger


class HookExpert(Expert):
    """Hover over where the fingers go in, descend, pull; start again whenever they have come out.

    Attributes:
        tolerance_m: horizontal error at which the fingers may go in, along the tool's heading and across it.
    """

    phase_names = ("hover", "descend", "pull")
    travels = (HOVER,)
    tolerance_m: ClassVar[tuple[float, float]]

    @abstractmethod
    def entry(self) -> tuple[np.ndarray, np.ndarray]:
        """Pose at which the fingers go in: position (n, 3) at the height of the bar to be hooked, heading (n,) rad."""

    @abstractmethod
    def hooked(self) -> np.ndarray:
        """(n,) bool: the fingers are where they can pull."""

    @abstractmethod
    def ahead(self) -> tuple[np.ndarray, np.ndarray]:
        """Pose to pull from: position (n, 3) at the height of the bar, a little further along its arc; heading (n,)."""

    def first_phase(self) -> np.ndarray:
        return np.where(self.hooked() & ~self._too_deep(), PULL, HOVER)

    def next_phase(self) -> np.ndarray:
        error = self._misalignment()
        hooked = self.hooked() & ~self._too_deep()
        rules = (
            (HOVER, (error <= 1.0) & self._facing(), DESCEND),
            (DESCEND, hooked, PULL),
            (DESCEND, error > LOST_ALIGNMENT, HOVER),
            (PULL, ~hooked, HOVER),
        )
        return self.following(rules)

    def command(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        phase, tool = self.phase, self.view.tool_pos
        (entry, yaw), (pulled, pulled_yaw) = self.entry(), self.ahead()
        deep, down = self._too_deep(), entry.copy()
        low_beside = (tool[:, 2] < self._height(entry) + CLEAR_M) & (planar_length(entry - tool) > APART_M)
        over = np.where((low_beside & ~deep)[:, None], tool, entry)
        stuck = deep & ((self._misalignment() > PALM_TOLERANCE) | ~self._facing())
        over[:, 2] = np.where(stuck, tool[:, 2], self._height(entry) + CRUISE_M)
        down[:, 2] = np.maximum(self._height(entry), tool[:, 2] - DESCENT_LEAD_M)
        pulled[:, 2] = self._height(pulled)
        position = np.select([(phase == p)[:, None] for p in range(3)], [over, down, pulled])
        heading = self._led_heading(np.where(phase == PULL, pulled_yaw, yaw))
        return position, pointing_down(heading), np.zeros(self.view.n)

    def noise_share(self) -> np.ndarray:
        return np.where(self.phase == HOVER, 1.0, NOISE_WHEN_LOW)

    def push(self, speed_share: np.ndarray) -> np.ndarray:
        """(n,) how far beyond the point of contact to send the fingers, m, at a share (n,) of the wanted speed."""
        more = min(PUSH_MORE_M, PUSH_MORE_M_KG * self.view.robot.vehicle.mass)
        return PUSH_M + more * np.clip(1.0 - speed_share, -1.0, 1.0)

    def _led_heading(self, yaw: np.ndarray) -> np.ndarray:
        """Return the heading on the way from the tool's to ``yaw`` (n,) that is ``TURN_LEAD_RAD`` ahead, or ``yaw``."""
        mat = self.view.tool_mat
        now = np.arctan2(-mat[:, 1], mat[:, 4])
        ahead = np.arctan2(np.sin(yaw - now), np.cos(yaw - now))
        return now + np.clip(ahead, -TURN_LEAD_RAD, TURN_LEAD_RAD)

    def _height(self, bar: np.ndarray) -> np.ndarray:
        """(n,) height of the tool, m, at which the fingers hook a bar at ``bar`` (n, 3)."""
        gripper = self.view.robot.gripper
        return bar[:, 2] + gripper.tip_distance - hook_depth(gripper)

    def _too_deep(self) -> np.ndarray:
        """(n,) bool: the palm, too, has gone down beside the bar, and would be caught under it on the way up."""
        entry, _ = self.entry()
        sunk = entry[:, 2] - self.view.tip_pos[:, 2] > PALM_SHARE * self.view.robot.gripper.finger_length
        return sunk & (planar_length(entry - self.view.tip_pos) < BESIDE_M)

    def _misalignment(self) -> np.ndarray:
        """(n,) horizontal error in units of what is tolerated, the larger of two directions."""
        entry, yaw = self.entry()
        error = entry - self.view.tool_pos
        c, s = np.cos(yaw), np.sin(yaw)
        along, across = c * error[:, 0] + s * error[:, 1], -s * error[:, 0] + c * error[:, 1]
        return np.maximum(np.abs(along) / self.tolerance_m[0], np.abs(across) / self.tolerance_m[1])

    def _facing(self) -> np.ndarray:
        """(n,) bool: the tool's heading is within 20° of what it should be."""
        mat, yaw = self.view.tool_mat, self.entry()[1]
        return np.cos(yaw) * mat[:, 2] + np.sin(yaw) * mat[:, 5] >= np.cos(np.deg2rad(20.0))


def hook_depth(gripper: Gripper) -> float:
    """Depth of the fingertips below the middle of a bar, m, so that the palm stays clear of it."""
    return min(TIP_M, TIP_SHARE * gripper.finger_length)
