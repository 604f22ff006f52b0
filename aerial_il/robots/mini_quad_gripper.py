"""A quadrotor of 0.7 kg with one pitch joint and a small gripper: the least that can still grasp.

With a single joint the arm cannot cancel what the base is off by sideways; the tool is as steady as the base.
"""

from __future__ import annotations

import numpy as np

from aerial_il.robots.parts.arm import Arm, Link
from aerial_il.robots.parts.gripper import Gripper
from aerial_il.robots.parts.rotorcraft import Rotorcraft, ring
from aerial_il.robots.robot import Robot

_pos, _axis = ring(4, 0.125, first_angle=np.pi / 4, height=0.015)

ROBOT = Robot(
    name="mini_quad_gripper",
    summary="Small quadrotor (0.7 kg) with one pitch joint and a small parallel gripper.",
    base=Rotorcraft(
        mass=0.62,
        inertia=(0.0027, 0.0027, 0.0048),
        rotor_pos=_pos,
        rotor_axis=_axis,
        rotor_drag_ratio=0.012 * np.array([1.0, -1.0, 1.0, -1.0]),
        rotor_radius=0.064,
        max_thrust=4.2,
        tau_up=0.02,
        tau_down=0.02,
        drag=(0.1, 0.1, 0.15),
        hub_size=(0.045, 0.032, 0.018),
    ),
    arm=Arm(
        (Link((0.0, 1.0, 0.0), (0.07, 0.0, 0.0), 0.007, 0.02, (-0.4, 1.9), 3.0, 0.6, 4.0, 0.12, 0.0006),),
        mount=(0.0, 0.0, -0.03),
    ),
    gripper=Gripper(mass=0.05, stroke=0.034, finger_length=0.045, pad_height=0.010, force=6.0),
    rest_forward=(0.0,),
    rest_down=(0.5 * np.pi,),
)
