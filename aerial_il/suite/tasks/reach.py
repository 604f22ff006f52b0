"""Reach: bring the tool to a pose in the air and hold it there."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.core.arrays import closeness, length, rotation_cosine
from aerial_il.core.rotations import rot6d_from_mat
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.props.marker import add_marker
from aerial_il.suite.tasks.task import Task, hover_start
from aerial_il.suite.view import View

POSITION_TOLERANCE_M = 0.02
ANGLE_TOLERANCE_RAD = np.deg2rad(10.0)
TARGET_LOW, TARGET_HIGH = np.array([-0.5, -0.5, 0.7]), np.array([0.5, 0.5, 1.3])
PITCH_RANGE_RAD = (0.5, 0.5 * np.pi)
YAW_RANGE_RAD = (-0.8, 0.8)
START_LOW, START_HIGH = np.array([-0.3, -0.3, 1.2]), np.array([0.3, 0.3, 1.6])


class Reach(Task):
    """Tool within 2 cm and 10° of a random pose for 1 s."""

    name = "reach"
    grade = "easy"
    instruction = "Bring the gripper to the marked pose and hold it there."
    time_limit_s = 20.0
    dwell_s = 1.0
    subtasks = ("within_10_cm", "at_position", "at_orientation")

    needs_flight = False

    def obstacle_to(self, robot: Robot) -> str | None:
        return None

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_marker(spec, tolerance=POSITION_TOLERANCE_M, arrow=0.12)

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        target = view.mocap_id("target")
        pos, yaw, pitch = _reachable_pose(view.robot, rng)
        view.mocap_pos[world, target] = pos
        c, s, cp, sp = np.cos(0.5 * yaw), np.sin(0.5 * yaw), np.cos(0.5 * pitch), np.sin(0.5 * pitch)
        view.mocap_quat[world, target] = [c * cp, -s * sp, c * sp, s * cp]  # yaw, then pitch

    def fields(self) -> tuple[Field, ...]:
        return (
            Field("target_pos", (3,), "task", unit="m", labels=("x", "y", "z")),
            Field("target_rot6d", (6,), "task"),
            Field("tool_to_target", (3,), "task", unit="m", labels=("x", "y", "z")),
        )

    def observe(self, view: View) -> dict[str, np.ndarray]:
        target = view.site_pos("target")
        return {
            "target_pos": target.copy(),
            "target_rot6d": rot6d_from_mat(view.site_mat("target")),
            "tool_to_target": target - view.tool_pos,
        }

    def solved(self, view: View) -> np.ndarray:
        flags = self.progress(view)
        return flags[:, 1] & flags[:, 2] & (view.unwanted_contacts == 0)

    def progress(self, view: View) -> np.ndarray:
        distance = length(view.site_pos("target") - view.tool_pos)
        cosine = rotation_cosine(view.site_mat("target"), view.tool_mat)
        near, there = distance <= 0.1, distance <= POSITION_TOLERANCE_M
        return np.stack([near, there, cosine >= np.cos(ANGLE_TOLERANCE_RAD)], axis=1)

    def reward(self, view: View) -> np.ndarray:
        distance = length(view.site_pos("target") - view.tool_pos)
        turned = 0.5 * (1.0 + rotation_cosine(view.site_mat("target"), view.tool_mat))
        position = 0.5 * closeness(distance, 0.3) + 0.5 * closeness(distance, 0.03)
        return position * (0.7 + 0.3 * turned)


def _reachable_pose(robot: Robot, rng: np.random.Generator) -> tuple[np.ndarray, float, float]:
    """A random position (m), heading and downward pitch (rad) of the tool to which the robot can bring it."""
    while True:
        pos = rng.uniform(TARGET_LOW, TARGET_HIGH)
        yaw, pitch = rng.uniform(*YAW_RANGE_RAD), rng.uniform(*PITCH_RANGE_RAD)
        c, s, cp, sp = np.cos(yaw), np.sin(yaw), np.cos(pitch), np.sin(pitch)
        if robot.reachable(pos, np.array([[c * cp, -s, c * sp], [s * cp, c, s * sp], [-sp, 0.0, cp]])):
            return pos, yaw, pitch


TASK = Reach()
