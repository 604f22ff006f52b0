"""The oracle: a gripper with a light wrist on a small body that ideal thrusters move at will. Only its weight is real.

It has no rotors to wait for, no air and no reach to run out of, so that a task that fails with it fails in the task.
"""

from __future__ import annotations

import numpy as np

from aerial_il.robots.parts.arm import Arm, Link
from aerial_il.robots.parts.gripper import Gripper
from aerial_il.robots.parts.thrusters import thrusters
from aerial_il.robots.robot import Robot

ROLL, PITCH = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)

ROBOT = Robot(
    name="floating_gripper",
    summary="A gripper with a 2-joint wrist on a body with ideal thrusters (2 kg): an upper bound for real vehicles.",
    base=thrusters(mass=1.8, radius=0.07, force=30.0),
    arm=Arm(
        (
            Link(ROLL, (0.02, 0.0, 0.0), 0.016, 0.03, (-1.2, 1.2), 3.0, 4.0, 15.0, 0.5, 0.004),
            Link(PITCH, (0.06, 0.0, 0.0), 0.014, 0.05, (-1.2, 2.6), 3.0, 4.0, 15.0, 0.5, 0.004),
        ),
        mount=(0.0, 0.0, -0.085),
    ),
    gripper=Gripper(mass=0.12, stroke=0.045, finger_length=0.065, pad_height=0.015, force=12.0),
    rest_forward=(0.0, 0.0),
    rest_down=(0.0, 0.5 * np.pi),
)
