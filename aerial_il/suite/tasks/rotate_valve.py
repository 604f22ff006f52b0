"""Rotate a valve: put a finger between the spokes of a handwheel and turn it by more than half a turn."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from aerial_il.control.dynamics import put
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import clip, closeness, norm, planar_norm, sub
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.feasibility import infeasible_pulling
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import Names, joint_pos, joint_vel, site_pos, tip_pos, tool_pos, untouched
from aerial_il.suite.props.place import place
from aerial_il.suite.props.valve import (
    GAP_M,
    RIM_RADIUS_M,
    VALVE_DAMPING,
    VALVE_FRICTION_NM,
    VALVE_OPEN_RAD,
    VALVE_STOP_RAD,
    WHEEL_RADIUS_M,
    add_valve,
)
from aerial_il.suite.tasks.fields import seen
from aerial_il.suite.tasks.task import Task, TaskKernels, hover_start

NEAR_M = 0.05
STOP_GIVE_RAD = 0.1
TURN_RAD_S = 0.8  # a sensible speed: vehicles can come round with it
START_ANGLE_RAD = (0.0, 0.25 * np.pi)  # from here it is at least half a turn to VALVE_OPEN_RAD
VALVE_LOW, VALVE_HIGH = np.array([-0.25, -0.3, 0.36]), np.array([0.25, 0.3, 0.50])
MOUNT_YAW_RAD = (5 * np.pi / 12, 10 * np.pi / 12)  # a robot that tows the yellow spoke comes round by up to 60°
START_LOW, START_HIGH = np.array([-0.25, -0.3, 1.2]), np.array([0.3, 0.2, 1.33])
VALVE, GAP = range(2)  # sites; the valve is the joint too


class RotateValve(Task):
    """Valve turned anticlockwise by at least π, against 0.3 N m of dry friction, and kept open for 0.5 s.

    The angle to turn is between π and 1.25 π, since the starting angle varies. Open: the yellow spoke is over the green
    mark or past it, up to the stop 29° farther, which yields by up to 6°. Friction differs between episodes in the
    tiers that vary it.
    """

    name = "rotate_valve"
    grade = "medium"
    instruction = "Turn the red handwheel anticlockwise until its yellow spoke is over the green mark."
    wordings = (
        "Turn the red handwheel by half a turn.",
        "Rotate the valve until the yellow spoke meets the green mark.",
        "逆时针转动红色手轮，直到黄色辐条对准绿色标记。",
        "把阀门转半圈。",
    )
    held_out = ("Turn the red handwheel until its yellow spoke is at the green mark.", "请把红色手轮转到绿色标记处。")
    time_limit_s = 30.0
    dwell_s = 0.5
    subtasks = ("over_gap", "between_spokes", "half_way", "open")
    names = Names(sites=("valve", "gap"), joints=("valve",))

    def own_infeasibility(self, robot: Robot) -> str | None:
        return infeasible_pulling(robot, (VALVE_FRICTION_NM + VALVE_DAMPING * TURN_RAD_S) / GAP_M)

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_valve(spec)

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        place(view, world, "valve_mount", rng.uniform(VALVE_LOW, VALVE_HIGH), yaw=rng.uniform(*MOUNT_YAW_RAD))
        angle, _ = view.joint("valve")
        angle[world] = rng.uniform(*START_ANGLE_RAD)

    def fields(self) -> tuple[Field, ...]:
        return (
            seen("valve_pos", "centre of the wheel"),
            seen("valve_angle", "of the wheel; 0 at the start", 1, unit="rad", frame="about the wheel's axis"),
            seen("valve_rate", "its rate", 1, unit="rad/s", frame="about the wheel's axis"),
            seen("gap_pos", "the opening behind the yellow spoke, for a finger"),
            seen("tool_to_gap", "from the tool to the opening"),
        )


@kernel
def observe(world, found):
    gap = site_pos(world, GAP)
    put(found, 0, site_pos(world, VALVE))
    found[3], found[4] = joint_pos(world, VALVE), joint_vel(world, VALVE)
    put(found, 5, gap)
    put(found, 8, sub(gap, tool_pos(world)))


@kernel
def solved(world):
    return is_open(world) and untouched(world)


@kernel
def progress(world, flags):
    angle = joint_pos(world, VALVE)
    flags[0] = planar_norm(sub(site_pos(world, GAP), tool_pos(world))) <= NEAR_M
    flags[1] = inserted(world)
    flags[2], flags[3] = angle >= VALVE_OPEN_RAD - 0.5 * math.pi, is_open(world)


@kernel
def reward(world):
    near = closeness(norm(sub(site_pos(world, GAP), tool_pos(world))), 0.15)
    turned = clip(joint_pos(world, VALVE) / VALVE_OPEN_RAD, 0.0, 1.0)
    return 0.25 * near + (0.1 if inserted(world) else 0.0) + 0.65 * turned


@kernel
def is_open(world):
    """Whether the spoke is at the mark, or between it and the stop."""
    return VALVE_OPEN_RAD <= joint_pos(world, VALVE) <= VALVE_STOP_RAD + STOP_GIVE_RAD


@kernel
def inserted(world):
    """Whether the fingertips are inside the rim and not above the wheel."""
    tip = sub(tip_pos(world), site_pos(world, VALVE))
    return tip[2] <= -RIM_RADIUS_M and planar_norm(tip) <= WHEEL_RADIUS_M


TASK = RotateValve(TaskKernels(observe=observe, solved=solved, progress=progress, reward=reward))
