"""A heavy quadrotor of 20.7 kg, read from its PX4 airframe file, with a 6-joint arm of the Z1's geometry hung below.

The arm is the Unitree Z1 turned upside down: what its data sheet and its published description call +y and +z point
to -y and -z of the base. Lengths, masses, joint limits and torques are the published ones; the shapes are our own.
"""

from __future__ import annotations

import numpy as np

from aerial_il.robots.parts.airframe import stored_airframe
from aerial_il.robots.parts.rotorcraft import Rotorcraft
from aerial_il.robots.parts.z1 import FOOT_KG, Z1_GRIPPER, z1_arm
from aerial_il.robots.robot import Robot

_airframe = stored_airframe("big_four")

# Postures with the elbow a radian off its stop and the tool well before the first joint's axis: a base that leans into
# the wind by 10° moves the tool by 16 cm, and an arm that meets a stop, or turns over about that axis, is thrown.
ROBOT = Robot(
    name="big_four_z1",
    summary="Heavy quadrotor from a PX4 airframe file (20.7 kg) with a 6-joint arm of 0.8 m reach below it.",
    base=Rotorcraft(
        mass=16.0 + FOOT_KG,
        inertia=(1.05, 1.05, 1.95),
        rotor_pos=_airframe.rotor_pos,
        rotor_axis=_airframe.rotor_axis,
        rotor_drag_ratio=_airframe.rotor_drag_ratio,
        rotor_radius=0.36,
        max_thrust=100.0,
        tau_up=0.05,
        tau_down=0.07,
        drag=(0.6, 0.6, 0.9),
        hub_size=(0.20, 0.15, 0.06),
    ),
    arm=z1_arm(mount=(0.0, 0.0, -0.06), hanging=True),
    gripper=Z1_GRIPPER,
    rest_forward=(0.0, 1.9, -1.4, -0.5, 0.0, 0.0),
    rest_down=(0.0, 1.7, -1.8, 0.1 - 0.5 * np.pi, 0.0, 0.0),
)
