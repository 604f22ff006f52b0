"""Pick from a moving table: take a cube off a table that swings to and fro or round, and let go of it in a bowl.

The table's course is a line or a circle, at a speed and a period that nobody tells the robot: it sees where the table
is and how fast it moves, and must be as fast itself while it closes its fingers.
"""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.core.kernels import kernel
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import Names, joint_pos, joint_vel
from aerial_il.suite.props import CUBE_HALF_M, TABLE_HEIGHT_M
from aerial_il.suite.props.moving_table import add_moving_table, set_in_motion
from aerial_il.suite.props.place import place
from aerial_il.suite.props.post import add_post
from aerial_il.suite.tasks import pick_place
from aerial_il.suite.tasks.fields import seen
from aerial_il.suite.tasks.pick_place import PickPlace
from aerial_il.suite.tasks.task import TaskKernels, hover_start

SPEED_M_S, PERIOD_S = (0.05, 0.25), (4.0, 8.0)  # the largest along a line, or round a circle; of one lap
WIDEST_M = 0.25  # from the middle of the course: the fastest tables have the shorter periods
MIDDLE_LOW, MIDDLE_HIGH = np.array([-0.15, 0.12]), np.array([0.10, 0.22])
ON_TABLE_M = 0.07  # of the cube from the table's middle, along each axis
BOWL_LOW, BOWL_HIGH = np.array([-0.25, -0.50, 0.36]), np.array([0.25, -0.42, 0.44])
START_LOW, START_HIGH = np.array([-0.3, -0.3, 1.15]), np.array([0.3, 0.3, 1.4])
ALONG_X, ALONG_Y = 1, 2  # joints; what else is named has the numbers that it has in pick_place


class PickMoving(PickPlace):
    """Cube from the moving table released in the still bowl within 5 cm, slower than 5 cm/s, gripper 10 cm away, 0.5 s.

    In the bowl: the cube's centre is at most 5 cm from the bowl's axis and 2 to 5 cm above its underside. Released: no
    part of the robot touches it. Links and rotors must not touch anything.

    The table's top swings along a line in any direction, or runs round a circle either way, with a largest speed of
    0.05 to 0.25 m/s and a period of 4 to 8 s, at most 25 cm to either side of its middle; the cube lies on it by
    friction. It never stops. Tiers with `payload` change its mass by up to 30 %, and these by up to a fifth.

    A cube more than 10 cm below the table's surface that is not in the gripper is lost: the episode ends as dropped.
    """

    name = "pick_moving"
    grade = "hard"
    instruction = "Pick up the orange cube from the moving table and place it in the blue bowl."
    wordings = (
        "Take the orange cube off the moving table and put it into the bowl.",
        "Catch the cube on the table that moves, and drop it in the bowl.",
        "从移动的桌子上拿起橙色方块，放进碗里。",
        "抓住移动桌面上的方块，放到碗中。",
    )
    held_out = (
        "Grasp the cube on the moving table and put it in the bowl.",
        "请从移动的桌上抓起方块放进碗。",
    )
    names = Names(
        sites=("cube", "bowl", "track"),
        joints=("cube", "table_x", "table_y"),
        contacts=("grip_left", "grip_right", "robot_on_cube"),
    )
    needs_flight = True

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        pick_place.add_cube_and_bowl(spec)
        add_post(spec, "bowl_stand", 0.03)
        add_moving_table(spec)

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        bowl = rng.uniform(BOWL_LOW, BOWL_HIGH)
        for body in ("bowl", "bowl_stand"):
            place(view, world, body, bowl)
        middle, (offset, velocity, period) = rng.uniform(MIDDLE_LOW, MIDDLE_HIGH), _course(rng)
        set_in_motion(view, world, middle, offset, velocity, period)
        cube, yaw = middle + offset + rng.uniform(-ON_TABLE_M, ON_TABLE_M, 2), rng.uniform(-np.pi, np.pi)
        pose, speed = view.free_joint("cube")
        view.qpos[world, pose] = [*cube, TABLE_HEIGHT_M + CUBE_HALF_M, np.cos(0.5 * yaw), 0.0, 0.0, np.sin(0.5 * yaw)]
        view.qvel[world, speed] = [*velocity, 0.0, 0.0, 0.0, 0.0]

    def fields(self) -> tuple[Field, ...]:
        return (
            *super().fields(),
            seen("table_offset", "from the middle of the table's track to the table", 2, labels=("x", "y")),
            seen("table_vel", "velocity of the table", 2, unit="m/s", labels=("x", "y")),
        )


def _course(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, float]:
    """Where the table starts, (2,) m from the middle of its course, how fast, (2,) m/s, and its period, s."""
    speed, phase = rng.uniform(*SPEED_M_S), rng.uniform(-np.pi, np.pi)
    period = rng.uniform(PERIOD_S[0], min(PERIOD_S[1], 2.0 * np.pi * WIDEST_M / speed))
    radius, direction = speed * period / (2.0 * np.pi), rng.uniform(-np.pi, np.pi)
    along = np.array([np.cos(direction), np.sin(direction)])
    across = rng.choice([-1.0, 0.0, 0.0, 1.0]) * np.array([-along[1], along[0]])  # round either way, or on a line
    offset = radius * (np.cos(phase) * along + np.sin(phase) * across)
    velocity = speed * (np.cos(phase) * across - np.sin(phase) * along)
    return offset, velocity, float(period)


@kernel
def observe(world, found):
    pick_place.observe(world, found)
    for k, joint in enumerate((ALONG_X, ALONG_Y)):
        found[14 + k], found[16 + k] = joint_pos(world, joint), joint_vel(world, joint)


@kernel
def table_offset(world):
    """From the middle of the table's track to the table, world frame, m."""
    return (joint_pos(world, ALONG_X), joint_pos(world, ALONG_Y), 0.0)


@kernel
def table_vel(world):
    """Velocity of the table, world frame, m/s."""
    return (joint_vel(world, ALONG_X), joint_vel(world, ALONG_Y), 0.0)


TASK = PickMoving(
    TaskKernels(
        observe=observe,
        solved=pick_place.solved,
        progress=pick_place.progress,
        reward=pick_place.reward,
        lost=pick_place.lost,
    )
)
