"""Flying so that the robot's cameras see what comes next: the heading turns towards it wherever nothing needs it.

While the tool travels only its position counts. About the vertical through the tool the robot is then free to turn, and
turns just so far that what it flies to is ahead of it; before it arrives its heading is the expert's own again.
"""

import numpy as np

from aerial_il.core.arrays import planar_length
from aerial_il.suite.physics.view import View

AHEAD_RAD = 0.5  # within this of straight ahead a place is well within the frames of all robots' cameras
ARRIVING_M = 0.25  # from there on the heading comes back, and from twice as far it is free
LEAD_NEAR_M = 0.08  # how far ahead of itself the tool is sent near what it flies to


def turned_to_see(view: View, target: np.ndarray, rot6d: np.ndarray, travels: np.ndarray) -> np.ndarray:
    """Return commanded attitudes (n, 6), turned about the vertical where that brings ``target`` (n, 3) ahead.

    Args:
        travels: (n,) bool, only the tool's position counts.
    """
    ahead = target - view.base_pos
    aside = np.arctan2(ahead[:, 1], ahead[:, 0]) - np.arctan2(-rot6d[:, 3], rot6d[:, 4])
    aside = np.arctan2(np.sin(aside), np.cos(aside))
    free = travels * np.clip(planar_length(target - view.tool_pos) / ARRIVING_M - 1.0, 0.0, 1.0)
    angle = free * (aside - np.clip(aside, -AHEAD_RAD, AHEAD_RAD))
    cos, sin, turned = np.cos(angle)[:, None], np.sin(angle)[:, None], rot6d.copy()
    x, y = rot6d[:, 0::3], rot6d[:, 1::3]
    turned[:, 0::3], turned[:, 1::3] = cos * x - sin * y, sin * x + cos * y
    return turned


def lead_of(distance: np.ndarray, lead: float) -> np.ndarray:
    """Return how far ahead of itself (n,) m a tool is sent that is ``distance`` (n,) m from what it flies to."""
    return np.where(distance < ARRIVING_M, min(lead, LEAD_NEAR_M), lead)
