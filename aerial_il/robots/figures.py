"""Figures of a robot, computed from its nominal model: power, balance, workspace, load of its servos."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from aerial_il.control.dynamics import POSITION, ROTATION, forward_kinematics, inverse_dynamics
from aerial_il.control.scratch import make_scratch
from aerial_il.control.vehicle import GRAVITY, MAX_JOINTS
from aerial_il.core.rotations import IDENTITY
from aerial_il.robots.parts.described.inertia import about
from aerial_il.robots.robot import Robot

AIR_DENSITY = 1.225  # kg/m³, at sea level
FIGURE_OF_MERIT = 0.65  # of small rotors: ideal over actual power
POSTURES = 20_000  # random ones, by which workspace and loads are estimated
ORIGIN = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Stance:
    """A posture of the arm at level hover.

    Attributes:
        name: of the posture. tool, com: (3,) tool and common centre of mass in the base frame, m.
        inertia: (3,) moments about the centre of mass, kg m². thrust: (R,) of the rotors, N.
    """

    name: str
    tool: np.ndarray
    com: np.ndarray
    inertia: np.ndarray
    thrust: np.ndarray


def hover_power(robot: Robot) -> float | None:
    """Ideal power (W) of hovering with the tool down, or None for a robot without rotors in the air.

    Momentum theory: a rotor of disc area A takes ``T^(3/2) / sqrt(2 ρ A)`` (Leishman, Principles of Helicopter
    Aerodynamics, 2nd ed. 2006, eq. 2.15). Motors take that over their figure of merit.
    """
    if robot.fixed or robot.base.rotor_radius == 0.0:
        return None
    thrust, area = stances(robot)[0].thrust, math.pi * robot.base.rotor_radius**2
    return float(np.sum(np.maximum(thrust, 0.0) ** 1.5) / math.sqrt(2.0 * AIR_DENSITY * area))


@cache
def stances(robot: Robot) -> tuple[Stance, ...]:
    """Balance with the tool down, with the tool ahead, and with the arm stretched as far ahead as it goes."""
    if not robot.num_joints:
        return (stance(robot, "bare", np.zeros(0)),)
    joints, tools = workspace(robot)
    farthest = joints[np.argmax(tools[:, 0] - np.abs(tools[:, 1]))]
    named = {"tool down": robot.rest_down, "tool ahead": robot.rest_forward, "stretched ahead": farthest}
    return tuple(stance(robot, name, np.array(posture, float)) for name, posture in named.items())


@cache
def workspace(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Workspace of the tool: joint positions (N, J) rad and tool positions (N, 3) m in the base frame.

    Random postures within the joint limits, less those that bring the tool into the body: of a hanging arm those above
    the base's underside, of a standing one those below its floor; none where that leaves nothing, of an arm on top.
    """
    vehicle, rng = robot.vehicle, np.random.default_rng(0)
    joints = rng.uniform(vehicle.joint_low, vehicle.joint_high, (POSTURES, robot.num_joints))
    tools = np.array([robot.tool_at(posture)[0] for posture in joints])
    floor = -robot.base.pose[2]
    free = tools[:, 2] > floor if robot.fixed else tools[:, 2] < -robot.base.hub_size[2]
    return (joints[free], tools[free]) if free.any() else (joints, tools)


@cache
def servo_loads(robot: Robot) -> np.ndarray:
    """(J,) largest torque that gravity asks of each servo in any posture, as a share of its limit."""
    vehicle, record, frames = robot.vehicle, robot.record, make_scratch().frames
    rest, torque, worst = np.zeros(MAX_JOINTS), np.zeros(MAX_JOINTS), np.zeros(robot.num_joints)
    rng = np.random.default_rng(0)
    for joints in rng.uniform(vehicle.joint_low, vehicle.joint_high, (POSTURES // 10, robot.num_joints)):
        forward_kinematics(record, ORIGIN, IDENTITY, joints, 0, frames)
        inverse_dynamics(record, frames, ORIGIN, IDENTITY, ORIGIN, rest, ORIGIN, ORIGIN, rest, torque)
        worst = np.maximum(worst, np.abs(torque[: robot.num_joints]))
    return worst / np.array([link.torque for link in robot.arm.links])


def chain(robot: Robot, joints: np.ndarray) -> np.ndarray:
    """(J + 1, 3) positions of the joints and of the tool in the base frame, m, for joint positions (J,) rad."""
    return _placed(robot, joints)[:, POSITION : POSITION + 3]


def _placed(robot: Robot, joints: np.ndarray) -> np.ndarray:
    """(J + 1, FRAME_SIZE) frames of links and tool, in the base frame."""
    frames = make_scratch().frames
    forward_kinematics(robot.record, ORIGIN, IDENTITY, joints, 0, frames)
    return frames[: robot.num_joints + 1]


def stance(robot: Robot, name: str, joints: np.ndarray) -> Stance:
    """Return the balance of ``robot`` with its joints at (J,) rad."""
    vehicle, frames = robot.vehicle, _placed(robot, joints)
    masses, places, tensors = [vehicle.base_mass], [np.zeros(3)], [np.diag(vehicle.base_inertia)]
    for j in range(robot.num_joints):
        rot = frames[j, ROTATION : ROTATION + 9].reshape(3, 3)
        masses.append(vehicle.link_mass[j])
        places.append(frames[j, POSITION : POSITION + 3] + rot @ vehicle.link_com[j])
        tensors.append(rot @ np.diag(vehicle.link_inertia[j]) @ rot.T)
    com = np.average(places, axis=0, weights=masses)
    total = sum(tensors) + sum(m * about(p - com) for m, p in zip(masses, places, strict=True))
    lift = np.array([0.0, 0.0, vehicle.mass * GRAVITY])
    thrust = vehicle.mixer @ np.concatenate([lift, np.cross(com, lift)])
    return Stance(name, robot.tool_at(joints)[0], com, np.diag(np.asarray(total)).copy(), thrust)
