"""Toss a ball: take it off a tee and throw it into a bin that is out of reach."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import mujoco
import numpy as np

from aerial_il.control.dynamics import put, vec
from aerial_il.control.vehicle import GRAVITY, Gains
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import add, clip, closeness, norm, planar_norm, scale, sub
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import (
    Names,
    base_pos,
    free_vel,
    site_pos,
    task_state,
    tool_pos,
    touching,
    untouched,
)
from aerial_il.suite.props.place import place
from aerial_il.suite.props.toss import (
    BALL_RADIUS_M,
    BIN_RADIUS_M,
    BIN_WALL_M,
    TEE_TOP_M,
    add_ball_on_tee,
    add_fenced_bin,
)
from aerial_il.suite.tasks.fields import seen, velocity
from aerial_il.suite.tasks.task import FREE_HANG_M, Task, TaskKernels, hover_start
from aerial_il.suite.timing import CONTROL_DT_S

INSIDE_M, LOW_M, HIGH_M = 0.15, 0.07, 0.12  # of the ball's middle from the bin's axis, and over its underside
AT_REST_M_S = 0.05
FILTER_S = 0.06  # of the velocity that is shown
LIFTED_M = 0.10
THROW_HEIGHT_M = 2.3  # of the tool where it lets go
SPEED_SHARE = 0.95  # of the fastest that a tool is led, which a ball has when it is let go
BRAKING_M = 0.10  # of the base, between letting go and standing still
TEE_LOW, TEE_HIGH = np.array([-0.20, -1.00, 0.55]), np.array([0.20, -0.80, 0.70])
BIN_LOW, BIN_HIGH = np.array([-0.25, 0.80]), np.array([0.25, 1.00])
START_LOW, START_HIGH = np.array([-0.15, -0.15, 0.20]), np.array([0.15, 0.15, 0.35])  # of the tool from the tee
HEADING_RAD = (0.5 * np.pi - 0.3, 0.5 * np.pi + 0.3)  # about that of the bin
BALL, BIN, FENCE = range(3)  # sites; the ball is the first joint too
GRIP_LEFT, GRIP_RIGHT, ROBOT_ON_BALL, ON_GROUND = range(4)  # contacts
ENTERED, VELOCITY = 0, 1  # in the task's state: whether the base has been inside the fence too early; seen velocity


class TossBall(Task):
    """Ball in the bin, slower than 5 cm/s and touched by no part of the robot, for 0.5 s; the base stayed outside.

    In the bin: its middle is at most 15 cm from the bin's axis and 7 to 12 cm above its underside (9 cm lying in it).
    The ball of 6 cm and 50 g lies on a tee at the start. The fence is a circle painted around the bin, as far from its
    middle as the robot's fingertips can ever be from its base, and the bin's radius of 16 cm more: from outside nobody
    drops a ball into it. Links and rotors must not touch anything.

    A base inside the fence before the ball is in the bin, and a ball on the ground, are lost: the episode ends as
    dropped.
    """

    name = "toss_ball"
    grade = "hard"
    instruction = "Take the orange ball off its tee and throw it into the blue bin without entering the red circle."
    wordings = (
        "Throw the orange ball into the blue bin from outside the red circle.",
        "Toss the ball from its tee into the bin, out of reach.",
        "从红圈外把橙色的球抛进蓝色箱子。",
        "将球投入够不着的箱中。",
    )
    held_out = (
        "Toss the orange ball into the bin and stay out of the red circle.",
        "请把球扔进箱子，不要进红圈。",
    )
    time_limit_s = 30.0
    dwell_s = 0.5
    subtasks = ("at_ball", "grasped", "lifted", "thrown", "in_bin")
    names = Names(
        sites=("ball", "bin", "fence"),
        joints=("ball",),
        contacts=("grip_left", "grip_right", "robot_on_ball", "ball_on_ground"),
    )
    scene_height_m = 1.4
    velocities: ClassVar[Mapping[str, int]] = {"ball": VELOCITY}
    scene_distance = 1.9

    def own_infeasibility(self, robot: Robot) -> str | None:
        opening, needed = 2.0 * robot.gripper.stroke, 2.4 * BALL_RADIUS_M
        if opening < needed:
            return f"its gripper opens {100 * opening:.1f} cm, the ball needs {100 * needed:.1f} cm"
        speed = SPEED_SHARE * Gains().fitted(robot.vehicle).reference_speed
        flight = speed * math.sqrt(2.0 * (THROW_HEIGHT_M - BIN_WALL_M) / GRAVITY)
        ahead = float(robot.tool_at(robot.rest_forward)[0][0])
        missing = fence_radius(robot) + BRAKING_M - ahead - 0.5 * BIN_RADIUS_M
        if flight < missing:
            return (
                f"at {speed:.2f} m/s a ball flies {flight:.2f} m from its gripper, and the bin is {missing:.2f} m away"
            )
        return None

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_ball_on_tee(spec)
        add_fenced_bin(spec, fence_radius(robot))

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        tee, bin_ = rng.uniform(TEE_LOW, TEE_HIGH), rng.uniform(BIN_LOW, BIN_HIGH)
        place(view, world, "tee", tee)
        place(view, world, "bin", np.array([*bin_, 0.0]), yaw=rng.uniform(-np.pi, np.pi))
        pose, _ = view.free_joint("ball")
        view.qpos[world, pose] = [*tee[:2], tee[2] + TEE_TOP_M, 1.0, 0.0, 0.0, 0.0]
        base = tee + rng.uniform(START_LOW, START_HIGH)
        base[2] += min(view.robot.hang, FREE_HANG_M)
        hover_start(view, world, base, rng.uniform(*HEADING_RAD))

    def fields(self) -> tuple[Field, ...]:
        return (
            seen("ball_pos", "middle of the ball"),
            velocity("ball_vel", "velocity of the ball", FILTER_S),
            seen("bin_pos", "middle of the bin, on the ground"),
            seen("tool_to_ball", "from the tool to the ball"),
            seen("ball_to_bin", "from the ball to the bin"),
            seen("base_to_fence", "how far the base is outside the fence", 1, frame="horizontal"),
        )


def fence_radius(robot: Robot) -> float:
    """From the bin's middle to the fence, m: out of a robot's reach, wherever outside it is."""
    stretched = float(np.linalg.norm(robot.arm.mount)) + robot.arm.reach + robot.gripper.finger_length
    return stretched + BIN_RADIUS_M


@kernel
def observe(world, found):
    ball, bin_pos = site_pos(world, BALL), site_pos(world, BIN)
    put(found, 0, ball)
    put(found, 3, vec(task_state(world), VELOCITY))
    put(found, 6, bin_pos)
    put(found, 9, sub(ball, tool_pos(world)))
    put(found, 12, sub(bin_pos, ball))
    found[15] = outside(world)


@kernel
def remember(world):
    """Note whether the base has been too near to the bin, and how fast the ball is."""
    state = task_state(world)
    if outside(world) < 0.0 and not at_rest_in_bin(world):
        state[ENTERED] = 1.0
    old, share = vec(state, VELOCITY), CONTROL_DT_S / (FILTER_S + CONTROL_DT_S)
    put(state, VELOCITY, add(old, scale(share, sub(free_vel(world, BALL), old))))


@kernel
def solved(world):
    fair = task_state(world)[ENTERED] == 0.0 and untouched(world)
    return fair and at_rest_in_bin(world) and not touching(world, ROBOT_ON_BALL)


@kernel
def lost(world):
    return touching(world, ON_GROUND) or task_state(world)[ENTERED] > 0.0


@kernel
def progress(world, flags):
    ball, held = site_pos(world, BALL), grasped(world)
    flags[0], flags[1] = norm(sub(ball, tool_pos(world))) <= 0.03, held
    flags[2] = held and not touching(world, ON_GROUND) and ball[2] >= THROW_HEIGHT_M - 2.0 * LIFTED_M
    flags[3], flags[4] = in_bin(world) or flying(world), in_bin(world)


@kernel
def reward(world):
    ball = site_pos(world, BALL)
    if in_bin(world):
        return 0.9 if at_rest_in_bin(world) else 0.8
    if grasped(world) or flying(world):
        near = closeness(planar_norm(sub(ball, site_pos(world, BIN))), 0.5)
        return 0.3 + 0.2 * clip(ball[2] / THROW_HEIGHT_M, 0.0, 1.0) + 0.2 * near
    return 0.3 * closeness(norm(sub(ball, tool_pos(world))), 0.1)


@kernel
def grasped(world):
    """Whether both pads touch the ball."""
    return touching(world, GRIP_LEFT) and touching(world, GRIP_RIGHT)


@kernel
def flying(world):
    """Whether the ball is on its way, faster than a hand is led; also when it falls: success asks where it lands."""
    return not touching(world, ROBOT_ON_BALL) and norm(free_vel(world, BALL)) > 0.5


@kernel
def outside(world):
    """How far the base is outside the fence, horizontally, m; negative inside."""
    bin_pos = site_pos(world, BIN)
    return planar_norm(sub(base_pos(world), bin_pos)) - planar_norm(sub(site_pos(world, FENCE), bin_pos))


@kernel
def in_bin(world):
    """Whether the ball is between the bin's walls."""
    offset = sub(site_pos(world, BALL), site_pos(world, BIN))
    return planar_norm(offset) <= INSIDE_M and LOW_M <= offset[2] <= HIGH_M


@kernel
def at_rest_in_bin(world):
    """Whether the ball lies still in the bin."""
    return in_bin(world) and norm(free_vel(world, BALL)) <= AT_REST_M_S


TASK = TossBall(
    TaskKernels(observe=observe, solved=solved, progress=progress, reward=reward, remember=remember, lost=lost)
)
