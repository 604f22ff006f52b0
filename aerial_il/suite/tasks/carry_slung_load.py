"""Carry a slung load: lift it by its cable, carry it through a gate, set it down on a mark."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import mujoco
import numpy as np

from aerial_il.control.dynamics import put, vec
from aerial_il.control.vehicle import GRAVITY
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import add, clip, closeness, column, norm, planar_norm, rotate_back, scale, sub
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.feasibility import infeasible_lifting
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import (
    Names,
    free_vel,
    peak_force,
    site_mat,
    site_pos,
    task_state,
    tip_pos,
    touching,
    untouched,
)
from aerial_il.suite.props.place import place
from aerial_il.suite.props.slung_load import (
    BEAM_HEIGHT_M,
    HALF_WIDTH_M,
    LOAD_HALF_M,
    LOAD_KG,
    POST_M,
    ROD_M,
    add_gate,
    add_goal,
    add_slung_load,
)
from aerial_il.suite.tasks.fields import EXACT, direction, seen, velocity
from aerial_il.suite.tasks.task import FREE_HANG_M, Task, TaskKernels, hover_start
from aerial_il.suite.timing import CONTROL_DT_S

AT_GOAL_M, AT_REST_M_S, SWING_RAD = 0.10, 0.05, math.radians(5.0)
UPRIGHT_COS = math.cos(math.radians(10.0))
CABLE_ROOM_M = ROD_M + 0.005  # of the cable from the axis of a post or the beam
LIFTED_M = 0.10
FILTER_S = 0.06  # of the velocity that is shown
TIP_START_M = (0.84, 0.96)  # over the ground: the cable is slack
ASIDE_M = (0.15, 0.25)  # of the fingertips from above the load, at the start
GATE_LOW, GATE_HIGH, GATE_YAW_RAD = np.array([-0.1, -0.1]), np.array([0.1, 0.1]), (-0.5, 0.5)
BEFORE_M, BEYOND_M, BESIDE_M = (0.60, 0.90), (0.60, 0.90), 0.30  # of start and goal from the gate, along x and y
LOAD, GATE, GOAL = range(3)  # sites; the load is the first joint too
ON_GROUND = 0  # contact
PASSED, CABLE_TOUCHED, SIDE, VELOCITY = 0, 1, 2, 3  # in the task's state; the third: x of the load in the gate's frame


class CarrySlungLoad(Task):
    """Load set down within 10 cm of the mark, after it was carried through the gate, swing at most 5°, for 1 s.

    The load of 300 g hangs by a cable of 1 m from the fingertips; the cable may be slack. Through the gate: the load's
    middle crosses the gate's plane forwards, between the posts (60 cm apart) and over the beam (35 cm high), while the
    fingertips are between the posts' planes too; who takes it back must come again. Nothing may ever touch the gate in
    an episode: not the robot, not the load, nor the cable, which is taken for straight.

    Set down: it stands on the ground, upright within 10°, slower than 5 cm/s, its middle within 10 cm of the mark's.
    Swing: angle of the line from the fingertips to the load's eye from the vertical. Links and rotors touch nothing.
    """

    name = "carry_slung_load"
    grade = "hard"
    instruction = "Lift the orange load by its cable, carry it through the red gate and set it down on the green mark."
    wordings = (
        "Carry the slung load through the gate and set it down at the mark.",
        "Fly the load on its cable through the red gate to the green mark.",
        "吊着橙色负载穿过红色门框，放到绿色标记上。",
        "把吊挂的负载运过门，放下。",
    )
    held_out = (
        "Take the load on the cable through the gate and put it down on the mark.",
        "请吊运负载穿过门框，放到标记处。",
    )
    time_limit_s = 40.0
    dwell_s = 1.0
    subtasks = ("lifted", "through_gate", "over_goal", "set_down", "gate_untouched")
    once_lost = ("gate_untouched",)
    names = Names(sites=("load", "gate", "goal"), joints=("load",), contacts=("load_on_ground",))
    force_sensors = ("gate_force",)
    scene_height_m = 0.9
    velocities: ClassVar[Mapping[str, int]] = {"load": VELOCITY}
    scene_distance = 1.6

    def own_infeasibility(self, robot: Robot) -> str | None:
        return infeasible_lifting(robot, LOAD_KG * GRAVITY)

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_slung_load(spec, robot)
        add_gate(spec)
        add_goal(spec, AT_GOAL_M)

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        middle, yaw = rng.uniform(GATE_LOW, GATE_HIGH), rng.uniform(*GATE_YAW_RAD)
        c, s = math.cos(yaw), math.sin(yaw)
        turn = np.array([[c, -s], [s, c]])
        load = middle + turn @ [-rng.uniform(*BEFORE_M), rng.uniform(-BESIDE_M, BESIDE_M)]
        goal = middle + turn @ [rng.uniform(*BEYOND_M), rng.uniform(-BESIDE_M, BESIDE_M)]
        place(view, world, "gate", np.array([*middle, 0.0]), yaw=yaw)
        place(view, world, "goal", np.array([*goal, 0.0]))
        pose, _ = view.free_joint("load")
        view.qpos[world, pose] = [*load, LOAD_HALF_M, math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)]
        angle, heading = rng.uniform(-np.pi, np.pi), rng.uniform(-0.3, 0.3)
        tip = load + rng.uniform(*ASIDE_M) * np.array([math.cos(angle), math.sin(angle)])
        _hover_with_tip(view, world, np.array([*tip, rng.uniform(*TIP_START_M)]), heading)
        view.task_state[world, SIDE] = -1.0

    def fields(self) -> tuple[Field, ...]:
        return (
            seen("load_pos", "middle of the load"),
            velocity("load_vel", "velocity of the load", FILTER_S),
            seen("tip_to_load", "from the fingertips to the load"),
            seen("load_to_gate", "from the load to the middle of the gate, on the ground"),
            direction("gate_direction", "x axis of the gate, which leads through it"),
            seen("load_to_goal", "from the load to the middle of the mark"),
            seen(
                "through", "1 once the load is through the gate", 1, unit="", frame="", labels=("passed",), noise=EXACT
            ),
        )


def _hover_with_tip(view: View, world: int, tip: np.ndarray, yaw: float) -> None:
    """Put the robot of one world at rest with its fingertips, which point down, at ``tip`` (3,) m."""
    x, y, z = view.robot.tool_at(view.robot.rest_down)[0] - [0.0, 0.0, view.robot.gripper.tip_distance]
    c, s = math.cos(yaw), math.sin(yaw)
    excess = max(0.0, view.robot.hang - FREE_HANG_M)  # which hover_start adds
    hover_start(view, world, tip - [c * x - s * y, s * x + c * y, z + excess], yaw)


@kernel
def observe(world, found):
    load, gate, axes = site_pos(world, LOAD), site_pos(world, GATE), site_mat(world, GATE)
    put(found, 0, load)
    put(found, 3, vec(task_state(world), VELOCITY))
    put(found, 6, sub(load, tip_pos(world)))
    put(found, 9, sub(gate, load))
    found[12], found[13] = axes[0], axes[3]
    put(found, 14, sub(site_pos(world, GOAL), load))
    found[17] = task_state(world)[PASSED]


@kernel
def remember(world):
    """Note which way the load crosses the gate's plane, whether the cable meets the gate, and how fast the load is."""
    state = task_state(world)
    load, tip, before = load_in_gate(world), in_gate(world, tip_pos(world)), state[SIDE]
    state[SIDE] = load[0]
    if before < 0.0 <= load[0] and inside(load) and abs(tip[1]) < HALF_WIDTH_M - CABLE_ROOM_M:
        state[PASSED] = 1.0
    elif before >= 0.0 > load[0]:
        state[PASSED] = 0.0
    if crosses_gate(tip, in_gate(world, eye(world))):
        state[CABLE_TOUCHED] = 1.0
    old, share = vec(state, VELOCITY), CONTROL_DT_S / (FILTER_S + CONTROL_DT_S)
    put(state, VELOCITY, add(old, scale(share, sub(free_vel(world, LOAD), old))))


@kernel
def solved(world):
    return (
        through(world) and gate_untouched(world) and set_down(world) and swing(world) <= SWING_RAD and untouched(world)
    )


@kernel
def progress(world, flags):
    flags[0], flags[1] = height(world) >= LIFTED_M, through(world)
    flags[2] = through(world) and to_goal(world) <= AT_GOAL_M
    flags[3], flags[4] = flags[2] and set_down(world), gate_untouched(world)


@kernel
def reward(world):
    steady = 0.6 + 0.4 * closeness(swing(world), 2.0 * SWING_RAD)
    if through(world):
        near = 0.5 * closeness(to_goal(world), 0.4) + 0.5 * closeness(to_goal(world), AT_GOAL_M)
        staged = 0.5 + 0.4 * near + (0.1 if set_down(world) else 0.0)
    else:
        load = load_in_gate(world)
        over = closeness(planar_norm(sub(site_pos(world, LOAD), tip_pos(world))), 0.05)
        raised = clip(height(world) / LIFTED_M, 0.0, 1.0)
        staged = 0.1 * over + raised * (0.15 + 0.2 * closeness(norm((load[0], load[1], 0.0)), 0.4))
    return steady * staged * (1.0 if gate_untouched(world) else 0.5)


@kernel
def in_gate(world, point):
    """A point (world frame, m) in the gate's frame."""
    return rotate_back(site_mat(world, GATE), sub(point, site_pos(world, GATE)))


@kernel
def load_in_gate(world):
    """The load's middle in the gate's frame, m."""
    return in_gate(world, site_pos(world, LOAD))


@kernel
def inside(point):
    """Whether a point of the gate's plane, gate frame, is between its posts and over its beam."""
    return abs(point[1]) < HALF_WIDTH_M - ROD_M and point[2] > BEAM_HEIGHT_M + ROD_M


@kernel
def crosses_gate(tip, load):
    """Whether the line between two points, gate frame, meets a post or the beam."""
    if (tip[0] < 0.0) == (load[0] < 0.0):
        return False
    point = add(tip, scale(tip[0] / (tip[0] - load[0]), sub(load, tip)))
    side = abs(point[1])
    at_post = abs(side - HALF_WIDTH_M) <= CABLE_ROOM_M and point[2] <= POST_M
    at_beam = side <= HALF_WIDTH_M and abs(point[2] - BEAM_HEIGHT_M) <= CABLE_ROOM_M
    return at_post or at_beam


@kernel
def eye(world):
    """Where the cable is tied to the load, world frame, m."""
    return add(site_pos(world, LOAD), scale(LOAD_HALF_M, column(site_mat(world, LOAD), 2)))


@kernel
def swing(world):
    """Angle of the line from the fingertips to the load's eye from the vertical, rad."""
    line = sub(eye(world), tip_pos(world))
    return math.atan2(planar_norm(line), -line[2])


@kernel
def height(world):
    """Height of the load's underside over the ground, m."""
    return site_pos(world, LOAD)[2] - LOAD_HALF_M


@kernel
def through(world):
    """Whether the load has been carried through the gate, and not taken back."""
    return task_state(world)[PASSED] > 0.0


@kernel
def gate_untouched(world):
    """Whether nothing has ever touched the gate."""
    return peak_force(world, 0) == 0.0 and task_state(world)[CABLE_TOUCHED] == 0.0


@kernel
def to_goal(world):
    """Horizontal distance of the load from the middle of the mark, m."""
    return planar_norm(sub(site_pos(world, GOAL), site_pos(world, LOAD)))


@kernel
def set_down(world):
    """Whether the load stands upright on the mark, at rest."""
    standing = touching(world, ON_GROUND) and column(site_mat(world, LOAD), 2)[2] >= UPRIGHT_COS
    return standing and to_goal(world) <= AT_GOAL_M and norm(free_vel(world, LOAD)) <= AT_REST_M_S


TASK = CarrySlungLoad(TaskKernels(observe=observe, solved=solved, progress=progress, reward=reward, remember=remember))
