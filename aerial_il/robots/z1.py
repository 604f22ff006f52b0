"""The arm of ``big_four_z1`` upright on a pedestal beside the table, for studies of manipulation without flight."""

from __future__ import annotations

import numpy as np

from aerial_il.robots.parts.pedestal import pedestal
from aerial_il.robots.parts.z1 import FOOT_KG, Z1_GRIPPER, z1_arm
from aerial_il.robots.robot import Robot

ROBOT = Robot(
    name="z1",
    summary="The 6-joint arm of big_four_z1 on a pedestal beside the table; it does not fly.",
    base=pedestal(place=(-0.445, 0.0), height=0.55, radius=0.07, mass=FOOT_KG),
    arm=z1_arm(mount=(0.0, 0.0, 0.0), hanging=False),
    gripper=Z1_GRIPPER,
    rest_forward=(0.0, 1.2, -1.4, 0.2, 0.0, 0.0),
    rest_down=(0.0, 1.3, -1.1, 0.5 * np.pi - 0.2, 0.0, 0.0),
)
