"""Hover: recover from a push, fly to a point and stand still there, heading as asked."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from aerial_il.control.dynamics import put
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import closeness, norm, sub
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import Names, air_force, base_mat, base_pos, site_mat, site_pos, untouched
from aerial_il.suite.props.marker import add_marker
from aerial_il.suite.props.place import place
from aerial_il.suite.tasks.fields import COS_SIN, GIVEN, OWN, direction, seen
from aerial_il.suite.tasks.task import Task, TaskKernels, hover_start

SETTLED_M, SETTLED_RAD = 0.05, math.radians(3.0)
SETTLED_COS, UPRIGHT_COS = math.cos(SETTLED_RAD), math.cos(math.radians(10.0))
TURNED = math.sqrt(1.0 - math.cos(4.0 * SETTLED_RAD))  # about in proportion to the angle
TURNED_LITTLE = math.sqrt(1.0 - SETTLED_COS)
TARGET_LOW, TARGET_HIGH = np.array([-0.3, -0.3, 0.8]), np.array([0.3, 0.3, 1.0])
HEADING_RANGE_RAD = (-0.8, 0.8)
STEP_M = (0.25, 0.45)  # how far from the target it starts
SPEED_M_S, TILT_RAD, RATE_RAD_S = 1.0, np.deg2rad(35.0), 2.0  # the largest at the start
TARGET = 0  # site


class Hover(Task):
    """Base within 5 cm of a point and within 3° of its trimmed attitude for 1 s.

    It starts up to 0.45 m away, moving at up to 1 m/s, tilted by up to 35° and rotating. The trimmed attitude has the
    required heading, and the tilt by which a vehicle that cannot push sideways balances the present force of the air:
    level in still air.
    """

    name = "hover"
    grade = "easy"
    instruction = "Hover at the marked point, facing along the arrow."
    wordings = (
        "Fly to the marked point and hover there, facing along the arrow.",
        "Stay at the marked point.",
        "飞到标记点悬停，机头沿箭头方向。",
        "在标记点悬停。",
    )
    held_out = ("Stay at the marked point, facing along the arrow.", "请悬停在标记点。")
    time_limit_s = 20.0
    dwell_s = 1.0
    needs_arm = False
    subtasks = ("upright", "within_20_cm", "at_point", "at_attitude")
    names = Names(sites=("target",))
    commanded = ("target",)

    def own_infeasibility(self, robot: Robot) -> str | None:
        if robot.num_joints:
            return "it has an arm, and hovering is evaluated on the base alone, which a tool pose does not determine"
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
        return (
            seen("target_pos", "the marked point", noise=GIVEN),
            direction("target_heading", "required heading", labels=COS_SIN, noise=GIVEN),
            seen("base_to_target", "from the hub to the marked point", noise=OWN),
            direction("heading_error", "from the base's heading to the required one", labels=COS_SIN, noise=OWN),
        )


@kernel
def observe(world, found):
    target, heading = site_pos(world, TARGET), site_mat(world, TARGET)
    put(found, 0, target)
    found[3], found[4] = heading[0], heading[3]
    put(found, 5, sub(target, base_pos(world)))
    found[8], found[9] = heading_error(world)


@kernel
def solved(world):
    return distance(world) <= SETTLED_M and attitude_cosine(world) >= SETTLED_COS and untouched(world)


@kernel
def progress(world, flags):
    flags[0] = base_mat(world)[8] >= UPRIGHT_COS
    flags[1], flags[2] = distance(world) <= 0.2, distance(world) <= SETTLED_M
    flags[3] = attitude_cosine(world) >= SETTLED_COS


@kernel
def reward(world):
    position = 0.5 * closeness(distance(world), 0.3) + 0.5 * closeness(distance(world), SETTLED_M)
    turned = math.sqrt(max(0.0, 1.0 - attitude_cosine(world)))
    attitude = 0.5 * closeness(turned, TURNED) + 0.5 * closeness(turned, TURNED_LITTLE)
    return position * (0.5 + 0.5 * attitude)


@kernel
def distance(world):
    """From the base to the target, m."""
    return norm(sub(site_pos(world, TARGET), base_pos(world)))


@kernel
def attitude_cosine(world):
    """Cosine of the angle between the base's attitude and the trimmed one.

    A rotation by the heading's error about the vertical and one by the error of tilt about a horizontal axis make up
    ``cos = (1 + cos heading) (1 + cos tilt) / 2 - 1``.
    """
    base, air = base_mat(world), air_force(world)
    heading, _ = heading_error(world)
    x, y, z = -air[0], -air[1], world.weight - air[2]  # what the rotors must give
    sideways = math.sqrt(x * x + y * y)
    by_leaning = max(0.0, sideways - world.lateral_limit) / max(sideways, 1e-9)
    x, y = by_leaning * x, by_leaning * y
    along = base[2] * x + base[5] * y + base[8] * z
    return 0.5 * (1.0 + heading) * (1.0 + along / math.sqrt(x * x + y * y + z * z)) - 1.0


@kernel
def heading_error(world):
    """Cosine and sine of the angle from the base's heading to the target's."""
    base, target = base_mat(world), site_mat(world, TARGET)
    length = math.sqrt(base[0] * base[0] + base[3] * base[3]) + 1e-9
    c, s = base[0] / length, base[3] / length
    return c * target[0] + s * target[3], c * target[3] - s * target[0]


def _direction(rng: np.random.Generator) -> np.ndarray:
    """Random unit vector (3,)."""
    vector = rng.standard_normal(3)
    return vector / np.linalg.norm(vector)


TASK = Hover(TaskKernels(observe=observe, solved=solved, progress=progress, reward=reward))
