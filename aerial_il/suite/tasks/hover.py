"""Hover: recover from a push, fly to a point and stand still there, heading as asked."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from aerial_il.control.vehicle import GRAVITY
from aerial_il.core.arrays import closeness, length
from aerial_il.core.kernels import kernel
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.props.marker import add_marker
from aerial_il.suite.props.place import place
from aerial_il.suite.tasks.task import Task, hover_start
from aerial_il.suite.view import View

SETTLED_M, SETTLED_RAD = 0.05, np.deg2rad(3.0)
TARGET_LOW, TARGET_HIGH = np.array([-0.3, -0.3, 0.8]), np.array([0.3, 0.3, 1.0])
HEADING_RANGE_RAD = (-0.8, 0.8)
STEP_M = (0.25, 0.45)  # how far from the target it starts
SPEED_M_S, TILT_RAD, RATE_RAD_S = 1.0, np.deg2rad(35.0), 2.0  # the largest at the start


class Hover(Task):
    """Base within 5 cm of a point and within 3° of its trimmed attitude for 1 s.

    It starts up to 0.45 m off, moving at up to 1 m/s, tilted by up to 35° and turning. The trimmed attitude has the
    heading asked for and leans just as much against the air's force of the moment as the vehicle must that cannot push
    sideways by as much: level in still air.
    """

    name = "hover"
    grade = "easy"
    instruction = "Hover at the marked point, facing along the arrow."
    time_limit_s = 20.0
    dwell_s = 1.0
    needs_arm = False
    subtasks = ("upright", "within_20_cm", "at_point", "at_attitude")

    def obstacle_to(self, robot: Robot) -> str | None:
        if robot.num_joints:
            return "its arm leaves the base's place open; hovering is judged by the base alone"
        return None

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_marker(spec, tolerance=SETTLED_M, arrow=0.5)

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        target, heading = rng.uniform(TARGET_LOW, TARGET_HIGH), rng.uniform(*HEADING_RANGE_RAD)
        place(view, world, "target", target, yaw=heading)
        hover_start(view, world, target + rng.uniform(*STEP_M) * _direction(rng), 0.0)
        tilt, axis, yaw = rng.uniform(0.0, TILT_RAD), rng.uniform(-np.pi, np.pi), rng.uniform(*HEADING_RANGE_RAD)
        c, s, cy, sy = math.cos(0.5 * tilt), math.sin(0.5 * tilt), math.cos(0.5 * yaw), math.sin(0.5 * yaw)
        lean = [s * math.cos(axis - 0.5 * yaw), s * math.sin(axis - 0.5 * yaw)]  # about a horizontal axis, after yaw
        view.qpos[world, 3:7] = [c * cy, *lean, c * sy]
        view.qvel[world, :3] = rng.uniform(0.0, SPEED_M_S) * _direction(rng)
        view.qvel[world, 3:6] = rng.uniform(0.0, RATE_RAD_S) * _direction(rng)

    def fields(self) -> tuple[Field, ...]:
        xyz = ("x", "y", "z")
        return (
            Field("target_pos", (3,), "task", unit="m", labels=xyz),
            Field("target_heading", (2,), "task", labels=("cos", "sin")),
            Field("base_to_target", (3,), "task", unit="m", labels=xyz),
            Field("heading_error", (2,), "task", labels=("cos", "sin")),
        )

    def observe(self, view: View) -> dict[str, np.ndarray]:
        target, heading = view.site_pos("target"), view.site_mat("target")
        error = np.empty((view.n, 2))
        _write_heading_errors(view.base_mat, heading, error)
        return {
            "target_pos": target.copy(),
            "target_heading": heading[:, 0:6:3].copy(),
            "base_to_target": target - view.base_pos,
            "heading_error": error,
        }

    def solved(self, view: View) -> np.ndarray:
        flags = self.progress(view)
        return flags[:, 2] & flags[:, 3] & (view.unwanted_contacts == 0)

    def progress(self, view: View) -> np.ndarray:
        distance, cosine = length(view.site_pos("target") - view.base_pos), attitude_cosine(view)
        upright = view.base_mat[:, 8] >= math.cos(math.radians(10.0))
        return np.stack([upright, distance <= 0.2, distance <= SETTLED_M, cosine >= math.cos(SETTLED_RAD)], axis=1)

    def reward(self, view: View) -> np.ndarray:
        distance = length(view.site_pos("target") - view.base_pos)
        position = 0.5 * closeness(distance, 0.3) + 0.5 * closeness(distance, SETTLED_M)
        turned = closeness(1.0 - attitude_cosine(view), 1.0 - math.cos(4.0 * SETTLED_RAD))
        return position * (0.7 + 0.3 * turned)


def attitude_cosine(view: View) -> np.ndarray:
    """(n,) cosine of the angle between the base's attitude and the trimmed one.

    A rotation by the heading's error about the vertical and one by the error of tilt about a horizontal axis make up
    ``cos = (1 + cos heading) (1 + cos tilt) / 2 - 1``.
    """
    vehicle, found = view.robot.vehicle, np.empty(view.n)
    weight, limit = vehicle.mass * GRAVITY, vehicle.lateral_limit
    _write_attitude_cosines(view.base_mat, view.site_mat("target"), view.air_force, weight, limit, found)
    return found


@kernel
def _write_attitude_cosines(bases, targets, air_forces, weight, lateral_limit, found):
    for i in range(found.size):
        heading, _ = _heading_error(bases, targets, i)
        x, y, z = -air_forces[i, 0], -air_forces[i, 1], weight - air_forces[i, 2]  # what the rotors must give
        sideways = math.sqrt(x * x + y * y)
        by_leaning = max(0.0, sideways - lateral_limit) / max(sideways, 1e-9)
        x, y = by_leaning * x, by_leaning * y
        along = bases[i, 2] * x + bases[i, 5] * y + bases[i, 8] * z
        found[i] = 0.5 * (1.0 + heading) * (1.0 + along / math.sqrt(x * x + y * y + z * z)) - 1.0


@kernel
def _write_heading_errors(bases, targets, found):
    for i in range(found.shape[0]):
        found[i, 0], found[i, 1] = _heading_error(bases, targets, i)


@kernel
def _heading_error(bases, targets, i):
    """Cosine and sine of the angle from the base's heading to the target's in world ``i``."""
    x, y = bases[i, 0], bases[i, 3]
    norm = math.sqrt(x * x + y * y) + 1e-9
    c, s = x / norm, y / norm
    return c * targets[i, 0] + s * targets[i, 3], c * targets[i, 3] - s * targets[i, 0]


def _direction(rng: np.random.Generator) -> np.ndarray:
    """Random unit vector (3,)."""
    vector = rng.standard_normal(3)
    return vector / np.linalg.norm(vector)


TASK = Hover()
