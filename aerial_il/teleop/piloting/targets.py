"""Absolute targets that a person moves by rates: of the tool, or of base and joints; each writes one kind of action.

Targets stay within reach of what the vehicle does (the leash), so that a stick that is held against an obstacle winds
nothing up; seated at the current pose they take over without a jerk.
"""

import math
from collections.abc import Mapping
from typing import Protocol

import numpy as np

from aerial_il.control.actions import MAX_DISPLACEMENT, MAX_TURN
from aerial_il.control.vehicle import Vehicle
from aerial_il.core.rotations import (
    IDENTITY,
    add,
    limit_norm,
    mat_from_rotvec,
    mat_from_yaw,
    matmul,
    matmul_back,
    norm,
    orthonormalise,
    rotate,
    rotate_back,
    rotvec_from_mat,
    scale,
    sub,
    wrap_angle,
)
from aerial_il.teleop.piloting.assist import fenced, within_fence
from aerial_il.teleop.piloting.command import Command, Vec3

Obs = Mapping[str, np.ndarray]

LEASH_M, LEASH_RAD, JOINT_LEASH_RAD = 0.2, 0.5, 0.3
LED_RATE = 1.5  # rad/s: as fast as joints follow a leader arm, so that one held elsewhere pulls nothing along at once


class Targets(Protocol):
    """What is commanded at one action level."""

    def seat(self, obs: Obs) -> None:
        """Take what the vehicle does now for the target."""
        ...

    def step(self, command: Command, obs: Obs, dt: float) -> np.ndarray:
        """Move on by ``command`` for ``dt`` s; return the action without its gripper entry."""
        ...


class ToolTargets:
    """A tool pose, commanded at ``ee_pose``, or by its differences at ``ee_delta``.

    Args:
        relative: whether actions are differences.
    """

    def __init__(self, *, relative: bool) -> None:
        self._relative = relative
        self._pos: Vec3 = (0.0, 0.0, 0.0)
        self._rot = IDENTITY

    def seat(self, obs: Obs) -> None:
        self._pos, self._rot = vector(obs["ee_pos"]), rotation(obs["ee_rot6d"])

    def step(self, command: Command, obs: Obs, dt: float) -> np.ndarray:
        before_pos, before_rot = self._pos, self._rot
        self._pos = self._moved(command, obs, dt)
        self._rot = self._turned(command, obs, dt)
        if not self._relative:
            return np.array([*self._pos, *self._rot[0::3], *self._rot[1::3]])
        moved = rotate_back(before_rot, sub(self._pos, before_pos))
        turned = rotvec_from_mat(matmul_back(before_rot, self._rot))
        return np.array([*limit_norm(moved, MAX_DISPLACEMENT), *limit_norm(turned, MAX_TURN)])

    def _moved(self, command: Command, obs: Obs, dt: float) -> Vec3:
        actual, yaw = vector(obs["ee_pos"]), heading(obs)
        velocity = rotate(mat_from_yaw(yaw), command.linear)
        if command.carry:
            lever = sub(actual, vector(obs["base_pos"]))
            velocity = add(velocity, (-command.yaw_rate * lever[1], command.yaw_rate * lever[0], 0.0))
        wanted = add(self._pos, scale(dt, fenced(velocity, self._pos)))
        return within_fence(add(actual, limit_norm(sub(wanted, actual), LEASH_M)))

    def _turned(self, command: Command, obs: Obs, dt: float) -> tuple[float, ...]:
        roll, pitch = command.turn
        rate = rotate(mat_from_yaw(heading(obs)), (roll, pitch, command.yaw_rate))
        turned = matmul(mat_from_rotvec(scale(dt, rate)), self._rot)
        turned = orthonormalise(turned[0::3], turned[1::3])
        actual = rotation(obs["ee_rot6d"])
        before, after = (norm(rotvec_from_mat(matmul_back(actual, rot))) for rot in (self._rot, turned))
        return self._rot if after > max(before, LEASH_RAD) else turned


class BodyTargets:
    """Base position, yaw and joints, commanded at ``base_joint``.

    Args:
        vehicle: whose joints they are.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._pos: Vec3 = (0.0, 0.0, 0.0)
        self._yaw, self._joints = 0.0, np.zeros(vehicle.num_joints)

    def seat(self, obs: Obs) -> None:
        self._joints = np.array(obs.get("joint_pos", self._joints), float)
        if self._vehicle.base_mobility:
            self._pos, self._yaw = vector(obs["base_pos"]), heading(obs)

    def step(self, command: Command, obs: Obs, dt: float) -> np.ndarray:
        for joint, rate in command.joints:
            actual = float(obs["joint_pos"][joint])
            moved = min(max(self._joints[joint] + dt * rate, actual - JOINT_LEASH_RAD), actual + JOINT_LEASH_RAD)
            self._joints[joint] = min(max(moved, self._vehicle.joint_low[joint]), self._vehicle.joint_high[joint])
        for joint, rate in led_rates(command, self._vehicle, self._joints, dt):
            self._joints[joint] += dt * rate
        if not self._vehicle.base_mobility:
            return self._joints.copy()
        self._move_base(command, obs, dt)
        return np.array([*self._pos, self._yaw, *self._joints])

    def _move_base(self, command: Command, obs: Obs, dt: float) -> None:
        actual, yaw = vector(obs["base_pos"]), heading(obs)
        velocity = fenced(rotate(mat_from_yaw(yaw), command.linear), self._pos)
        ahead = limit_norm(sub(add(self._pos, scale(dt, velocity)), actual), LEASH_M)
        self._pos = within_fence(add(actual, ahead))
        turn = wrap_angle(self._yaw + dt * command.yaw_rate - yaw)
        self._yaw = wrap_angle(yaw + min(max(turn, -LEASH_RAD), LEASH_RAD))


class Rates:
    """Velocities, commanded at ``velocity``: the flight controller holds the place where they are zero.

    Args:
        vehicle: whose joints they are.
    """

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle

    def seat(self, obs: Obs) -> None:
        pass

    def step(self, command: Command, obs: Obs, dt: float) -> np.ndarray:
        joints = np.zeros(self._vehicle.num_joints)
        for joint, rate in command.joints:
            joints[joint] = rate
        if command.led:
            for joint, rate in led_rates(command, self._vehicle, np.asarray(obs["joint_pos"], float), 2.0 * dt):
                joints[joint] = rate
        if not self._vehicle.base_mobility:
            return joints
        velocity = fenced(rotate(mat_from_yaw(heading(obs)), command.linear), vector(obs["base_pos"]))
        return np.array([*velocity, command.yaw_rate, *joints])


def led_rates(command: Command, vehicle: Vehicle, joints: np.ndarray, time_s: float) -> list[tuple[int, float]]:
    """Return joint -> rad/s that bring ``joints`` (J,) to where a leader arm holds them within ``time_s``, capped."""
    rates = []
    for joint, angle in command.led:
        if joint < vehicle.num_joints:
            wanted = min(max(angle, vehicle.joint_low[joint]), vehicle.joint_high[joint])
            most = min(LED_RATE, vehicle.joint_speed[joint])
            rates.append((joint, min(max((wanted - joints[joint]) / time_s, -most), most)))
    return rates


def targets_for(level: str, vehicle: Vehicle) -> Targets:
    """Return the targets of an action level."""
    if level in ("ee_pose", "ee_delta"):
        return ToolTargets(relative=level == "ee_delta")
    return BodyTargets(vehicle) if level == "base_joint" else Rates(vehicle)


def heading(obs: Obs) -> float:
    """Return the base's heading in rad; zero where the base is fixed."""
    return math.atan2(obs["base_rot6d"][1], obs["base_rot6d"][0]) if "base_rot6d" in obs else 0.0


def vector(values: np.ndarray) -> Vec3:
    """Return three numbers as a tuple."""
    return float(values[0]), float(values[1]), float(values[2])


def rotation(rot6d: np.ndarray) -> tuple[float, ...]:
    """Return a rotation matrix, nine numbers row by row, from its first two columns."""
    return orthonormalise(vector(rot6d[:3]), vector(rot6d[3:]))
