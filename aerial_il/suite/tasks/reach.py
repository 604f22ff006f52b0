"""Reach: bring the tool to a pose in the air and hold it there."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from aerial_il.control.dynamics import put
from aerial_il.core.goals import GoalSpec
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import clip, closeness, norm, rotation_cosine, sub
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import Names, put_rot6d, site_mat, site_pos, tool_mat, tool_pos, untouched
from aerial_il.suite.props.marker import add_marker
from aerial_il.suite.tasks.fields import GIVEN, OWN, seen
from aerial_il.suite.tasks.task import Task, TaskKernels, hover_start

POSITION_TOLERANCE_M = 0.02
ANGLE_TOLERANCE_RAD = math.radians(10.0)
ANGLE_TOLERANCE_COS = math.cos(ANGLE_TOLERANCE_RAD)
TURNED_RAD = 1.0  # from the target's orientation, where the wide part of the reward for it is half
TARGET_LOW, TARGET_HIGH = np.array([-0.5, -0.5, 0.7]), np.array([0.5, 0.5, 1.3])
PITCH_RANGE_RAD = (0.5, 0.5 * np.pi)
YAW_RANGE_RAD = (-0.8, 0.8)
START_LOW, START_HIGH = np.array([-0.3, -0.3, 1.2]), np.array([0.3, 0.3, 1.6])
TARGET = 0  # site


def reached(achieved: np.ndarray, desired: np.ndarray, share: float = 1.0) -> np.ndarray:
    """Return 1.0 where poses of the tool are within a share of the tolerances of those wanted, else 0.0, (m,).

    Args:
        achieved, desired: (m, 9) position and first two columns of the rotation, world.
    """
    near = np.linalg.norm(achieved[:, :3] - desired[:, :3], axis=1) <= share * POSITION_TOLERANCE_M
    (a1, a2), (b1, b2) = (np.split(pose[:, 3:], 2, axis=1) for pose in (achieved, desired))
    columns = ((a1, b1), (a2, b2), (np.cross(a1, a2), np.cross(b1, b2)))
    trace = sum(np.sum(a * b, axis=1) for a, b in columns)
    smallest = ANGLE_TOLERANCE_COS if share == 1.0 else math.cos(share * ANGLE_TOLERANCE_RAD)
    return (near & (0.5 * (trace - 1.0) >= smallest)).astype(float)


class Reach(Task):
    """Tool within 2 cm and 10° of a random pose for 1 s."""

    name = "reach"
    grade = "easy"
    instruction = "Bring the gripper to the marked pose and hold it there."
    wordings = (
        "Move the gripper to the marked pose.",
        "Reach the marked pose and hold it.",
        "把夹爪移到标记的位姿并保持。",
        "让夹爪到达标记处。",
    )
    held_out = ("Take the gripper to the marked pose and keep it there.", "请将夹爪移到标记的位姿。")
    time_limit_s = 20.0
    dwell_s = 1.0
    subtasks = ("within_10_cm", "at_position", "at_orientation")
    names = Names(sites=("target",))
    commanded = ("target",)
    goal = GoalSpec(
        achieved=("ee_pos", "ee_rot6d"),
        desired=("target_pos", "target_rot6d"),
        reward=reached,
        offsets={"tool_to_target": ("target_pos", "ee_pos")},
        within=reached,
    )

    needs_flight = False

    def own_infeasibility(self, robot: Robot) -> str | None:
        return None

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_marker(spec, tolerance=POSITION_TOLERANCE_M, arrow=0.12, bar=0.1)

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        target = view.mocap_id("target")
        pos, yaw, pitch = _reachable_pose(view.robot, rng)
        view.mocap_pos[world, target] = pos
        c, s, cp, sp = np.cos(0.5 * yaw), np.sin(0.5 * yaw), np.cos(0.5 * pitch), np.sin(0.5 * pitch)
        view.mocap_quat[world, target] = [c * cp, -s * sp, c * sp, s * cp]  # yaw, then pitch

    def fields(self) -> tuple[Field, ...]:
        return (
            seen("target_pos", "the marked point", noise=GIVEN),
            seen("target_rot6d", "of the required rotation", 6, unit="", frame="world from target", noise=GIVEN),
            seen("tool_to_target", "from the tool to the marked point", noise=OWN),
        )


@kernel
def observe(world, found):
    target = site_pos(world, TARGET)
    put(found, 0, target)
    put_rot6d(found, 3, site_mat(world, TARGET))
    put(found, 9, sub(target, tool_pos(world)))


@kernel
def solved(world):
    return distance(world) <= POSITION_TOLERANCE_M and cosine(world) >= ANGLE_TOLERANCE_COS and untouched(world)


@kernel
def progress(world, flags):
    flags[0], flags[1] = distance(world) <= 0.1, distance(world) <= POSITION_TOLERANCE_M
    flags[2] = cosine(world) >= ANGLE_TOLERANCE_COS


@kernel
def reward(world):
    position = 0.5 * closeness(distance(world), 0.3) + 0.5 * closeness(distance(world), 0.03)
    turned = math.acos(clip(cosine(world), -1.0, 1.0))
    attitude = 0.5 * closeness(turned, TURNED_RAD) + 0.5 * closeness(turned, ANGLE_TOLERANCE_RAD)
    return position * (0.5 + 0.5 * attitude)


@kernel
def distance(world):
    """From the tool to the target, m."""
    return norm(sub(site_pos(world, TARGET), tool_pos(world)))


@kernel
def cosine(world):
    """Cosine of the angle between the tool's orientation and the target's."""
    return rotation_cosine(site_mat(world, TARGET), tool_mat(world))


def _reachable_pose(robot: Robot, rng: np.random.Generator) -> tuple[np.ndarray, float, float]:
    """A random position (m), heading and downward pitch (rad) of the tool to which the robot can bring it."""
    while True:
        pos = rng.uniform(TARGET_LOW, TARGET_HIGH)
        yaw, pitch = rng.uniform(*YAW_RANGE_RAD), rng.uniform(*PITCH_RANGE_RAD)
        c, s, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
        if robot.reachable(pos, np.array([[c * cp, -s, c * sp], [s * cp, c, s * sp], [-sp, 0.0, cp]])):
            return pos, yaw, pitch


TASK = Reach(TaskKernels(observe=observe, solved=solved, progress=progress, reward=reward))
