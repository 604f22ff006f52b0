"""An under-actuated quadrotor of 2.3 kg with a light arm: shoulder roll and three pitch joints, parallel gripper.

The roll joint lets the arm cancel the sideways error of a base that can only accelerate sideways by tilting.
"""

from __future__ import annotations

import numpy as np

from aerial_il.robots.parts.arm import Arm, Link
from aerial_il.robots.parts.gripper import Gripper
from aerial_il.robots.parts.rotorcraft import Rotorcraft, ring
from aerial_il.robots.robot import Robot

ROLL, PITCH = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)

_pos, _axis = ring(4, 0.25, first_angle=np.pi / 4, height=0.02)

ROBOT = Robot(
    name="ua_quad_arm4",
    summary="Underactuated quadrotor (2.3 kg) with a 4-joint arm and a parallel gripper.",
    base=Rotorcraft(
        mass=1.9,
        inertia=(0.021, 0.021, 0.038),
        rotor_pos=_pos,
        rotor_axis=_axis,
        rotor_drag_ratio=0.016 * np.array([1.0, -1.0, 1.0, -1.0]),
        rotor_radius=0.12,
        max_thrust=13.5,
        tau_up=0.0125,
        tau_down=0.025,
        drag=(0.25, 0.25, 0.35),
    ),
    arm=Arm(
        (
            Link(ROLL, (0.02, 0.0, 0.0), 0.018, 0.06, (-1.2, 1.2), 6.0, 4.0, 30.0, 1.2, 0.005),
            Link(PITCH, (0.17, 0.0, 0.0), 0.012, 0.12, (-0.25, 2.9), 6.0, 4.0, 30.0, 1.2, 0.005),
            Link(PITCH, (0.15, 0.0, 0.0), 0.011, 0.09, (0.15, 2.6), 6.0, 3.0, 25.0, 1.0, 0.004),
            Link(PITCH, (0.06, 0.0, 0.0), 0.010, 0.06, (-2.2, 2.2), 6.0, 2.0, 15.0, 0.6, 0.003),
        ),
        mount=(0.0, 0.0, -0.05),
    ),
    gripper=Gripper(mass=0.07, stroke=0.04, finger_length=0.05, pad_height=0.012, force=10.0),
    rest_forward=(0.0, -0.1, 1.0, -0.9),
    rest_down=(0.0, 0.35, 1.75, -0.53),
)
