"""The Unitree Z1, a 6-joint arm of 4.7 kg: published lengths, masses, joint limits and torques, shapes of our own."""

from __future__ import annotations

from dataclasses import replace

from aerial_il.robots.parts.arm import Arm, Link, Vector
from aerial_il.robots.parts.gripper import Gripper

WHITE, BLACK = (0.86, 0.87, 0.89, 1.0), (0.20, 0.21, 0.23, 1.0)
FOOT_M, FOOT_KG = 0.0585, 0.472  # of the fixed foot below the first joint
ROLL, PITCH, YAW = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)

UPRIGHT = (
    Link(YAW, (0.0, 0.0, 0.045), 0.042, 0.673, (-2.618, 2.618), 3.1, 30.0, 300.0, 18.0, 0.05),
    Link(PITCH, (-0.35, 0.0, 0.0), 0.034, 1.191, (0.0, 2.967), 3.1, 60.0, 600.0, 36.0, 0.10),
    Link(PITCH, (0.218, 0.0, 0.057), 0.030, 0.839, (-2.880, 0.0), 3.1, 30.0, 300.0, 15.0, 0.05),
    Link(PITCH, (0.07, 0.0, 0.0), 0.027, 0.564, (-1.518, 1.518), 3.1, 30.0, 120.0, 5.0, 0.02),
    Link(YAW, (0.0492, 0.0, 0.0), 0.026, 0.389, (-1.344, 1.344), 3.1, 30.0, 120.0, 4.0, 0.02),
    Link(ROLL, (0.1, 0.0, 0.0), 0.025, 0.289, (-2.793, 2.793), 3.1, 30.0, 80.0, 2.5, 0.01),
)
Z1_GRIPPER = Gripper(mass=0.276, stroke=0.045, finger_length=0.065, pad_height=0.015, force=15.0)


def z1_arm(*, mount: Vector, hanging: bool) -> Arm:
    """Return the arm on its foot.

    Args:
        mount: the foot's sole on the base, m. hanging: turned upside down about the forward axis.
    """
    links = tuple(_overturned(link) for link in UPRIGHT) if hanging else UPRIGHT
    x, y, z = mount
    return Arm(links, mount=(x, y, z - FOOT_M if hanging else z + FOOT_M), colours=(WHITE, BLACK))


def _overturned(link: Link) -> Link:
    """Return the link turned by half a turn about the x axis."""
    (ax, ay, az), (x, y, z) = link.axis, link.tip
    return replace(link, axis=(ax, -ay, -az), tip=(x, -y, -z))
