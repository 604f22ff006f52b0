"""A fully actuated hexarotor of 6.4 kg: rotors canted ±25° push sideways without tilting; 4-joint arm, reach 0.82 m."""

from __future__ import annotations

import numpy as np

from aerial_il.robots.parts.arm import Arm, Link
from aerial_il.robots.parts.gripper import Gripper
from aerial_il.robots.parts.rotorcraft import Rotorcraft, ring
from aerial_il.robots.robot import Robot

ROLL, PITCH = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)

_pos, _axis = ring(6, 0.375, first_angle=np.pi / 6, height=0.03, cant=np.deg2rad(25.0))

ROBOT = Robot(
    name="fa_hexa_arm4",
    summary="Fully actuated hexarotor with canted rotors (6.4 kg), a 4-joint arm and a parallel gripper.",
    base=Rotorcraft(
        mass=5.2,
        inertia=(0.20, 0.20, 0.36),
        rotor_pos=_pos,
        rotor_axis=_axis,
        rotor_drag_ratio=0.018 * np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0]),
        rotor_radius=0.152,
        max_thrust=26.0,
        tau_up=0.018,
        tau_down=0.025,
        drag=(0.3, 0.3, 0.45),
        hub_size=(0.12, 0.10, 0.05),
    ),
    arm=Arm(
        (
            Link(ROLL, (0.03, 0.0, 0.0), 0.028, 0.20, (-1.2, 1.2), 5.0, 10.0, 90.0, 5.0, 0.02),
            Link(PITCH, (0.34, 0.0, 0.0), 0.018, 0.40, (-0.25, 2.9), 5.0, 10.0, 90.0, 5.0, 0.02),
            Link(PITCH, (0.30, 0.0, 0.0), 0.016, 0.30, (0.15, 2.6), 5.0, 6.0, 60.0, 3.0, 0.012),
            Link(PITCH, (0.10, 0.0, 0.0), 0.014, 0.12, (-2.2, 2.2), 5.0, 3.0, 25.0, 1.0, 0.005),
        ),
        mount=(0.0, 0.0, -0.07),
    ),
    gripper=Gripper(mass=0.20, stroke=0.045, finger_length=0.065, pad_height=0.015, force=12.0),
    rest_forward=(0.0, -0.1, 1.0, -0.9),
    rest_down=(0.0, 0.35, 1.75, -0.53),
)
