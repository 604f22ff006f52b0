"""Feasibility rules that tasks share: forces and dexterity that a robot's body must have."""

from __future__ import annotations

import numpy as np

from aerial_il.control.vehicle import GRAVITY, Gains
from aerial_il.robots.parts.gripper import PAD_CONTACT
from aerial_il.robots.robot import Robot

STEADY_SHARE = 0.2  # of its weight a vehicle pulls sideways with, in wind too
STEADY_SHARE_OF_YAW = 0.5  # of the room that its rotors have in hover it turns things with
WANDER_M = 0.03  # of a base while its tool touches something
GENTLE_SHARE = 0.7  # of a largest force that its wander may use up
CARRIED_SHARE = 0.15  # of its weight it carries: its observer makes up for a fifth, and the load may weigh 30 % more
LEANING_SHARE = 0.3  # of its weight it leans on something with, and still flies


def infeasible_pulling(robot: Robot, force: float) -> str | None:
    """Say why ``robot`` cannot pull sideways with ``force`` N, or None if it can."""
    strength = STEADY_SHARE * robot.vehicle.mass * GRAVITY
    if strength < force:
        return f"it can pull with at most a fifth of its weight, {strength:.1f} N, and the task needs {force:.1f} N"
    return None


def infeasible_lifting(robot: Robot, force: float) -> str | None:
    """Say why ``robot`` cannot carry what weighs ``force`` N, or None if it can."""
    strength = CARRIED_SHARE * robot.vehicle.mass * GRAVITY
    if strength < force:
        return f"it can carry at most 15 % of its weight, {strength:.1f} N, and the task needs {force:.1f} N"
    return None


def infeasible_pressing(robot: Robot, force: float) -> str | None:
    """Say why ``robot`` cannot press with ``force`` N, or None if it can."""
    strength = LEANING_SHARE * robot.vehicle.mass * GRAVITY
    if strength < force:
        return f"it can press with at most 30 % of its weight, {strength:.1f} N, and the task needs {force:.1f} N"
    return None


def infeasible_twisting(robot: Robot, torque: float) -> str | None:
    """Say why ``robot`` cannot turn something about the vertical with ``torque`` N m, or None if it can."""
    vehicle = robot.vehicle
    hover = vehicle.mixer[:, 2] * vehicle.mass * GRAVITY
    room = np.minimum(vehicle.rotor_max - hover, hover - vehicle.rotor_min)
    strength = STEADY_SHARE_OF_YAW * float(np.min(room / np.maximum(np.abs(vehicle.mixer[:, 5]), 1e-9)))
    if strength < torque:
        return f"half of what its rotors can turn it with is {strength:.2f} N m, and the task needs {torque:.2f} N m"
    return None


def infeasible_gentleness(robot: Robot, force: float) -> str | None:
    """Say why ``robot`` cannot keep a contact below ``force`` N, or None if it can.

    A hovering base pushes back by its position gain times its mass for every metre that it is held off its reference.
    """
    stiffness = Gains().fitted(robot.vehicle).position * robot.vehicle.mass
    if WANDER_M * stiffness > GENTLE_SHARE * force:
        return (
            f"its base resists displacement with {0.01 * stiffness:.1f} N/cm, too much for contact forces of at most "
            f"{force:.0f} N"
        )
    return None


def infeasible_upright_hold(robot: Robot) -> str | None:
    """Say why ``robot`` cannot keep upright what it holds while its base leans, or None if it can."""
    axes = robot.vehicle.link_axis
    if robot.actuation == "under" and np.linalg.matrix_rank(axes) < 2:
        return "its base tilts when it moves sideways, and its arm cannot rotate about two axes to keep a peg upright"
    return None


def infeasible_standing(robot: Robot) -> str | None:
    """Say why ``robot`` cannot stand on a bar that its gripper holds below it, rotors at rest, or None if it can.

    With the tool straight down its weight tips it over the pads, which friction alone keeps from turning on the bar.
    """
    weight, gripper = robot.vehicle.mass * GRAVITY, robot.gripper
    lever = float(np.hypot(*(robot.centre_at(robot.rest_down) - robot.tool_at(robot.rest_down)[0])[:2]))
    held = 2.0 * PAD_CONTACT["friction"][0] * gripper.force * gripper.pad_height
    if weight * lever > held:
        return (
            f"standing on its gripper it would tip over: its weight acts {100 * lever:.1f} cm beside the fingers, with "
            f"{weight * lever:.1f} N m, and their pads hold {held:.2f} N m"
        )
    return None
