"""Perch: grip a bar, stop the rotors, stand on it, and fly off again."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from aerial_il.control.dynamics import put
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import clip, closeness, column, dot, norm, planar_norm, sub
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.feasibility import infeasible_standing
from aerial_il.suite.physics.contact_sensors import add_force_sensor, add_touch_sensor
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import (
    Names,
    base_mat,
    force,
    free_vel,
    gripper_opening,
    rotor_thrust,
    site_mat,
    site_pos,
    task_state,
    tool_mat,
    tool_pos,
    touching,
    untouched,
)
from aerial_il.suite.props.perch import BAR_HALF_M, add_perch
from aerial_il.suite.props.place import place
from aerial_il.suite.tasks.fields import EXACT, direction, seen
from aerial_il.suite.tasks.task import Task, TaskKernels, hover_start
from aerial_il.suite.timing import CONTROL_DT_S

PERCHED_S, LET_GO_SHARE = 5.0, 0.2  # how long, with at most which share of the thrust in hover
ENOUGH_STEPS = round(PERCHED_S / CONTROL_DT_S)
SQUEEZE_N, GRIP_SLACK_M = 3.0, 0.004  # of each finger at least; what the opening may exceed the bar by
BESIDE_M, ALONG_M = 0.01, 0.15  # of the tool from the middle of the bar, across and along it
REACH_M = 0.03  # of the tool above or below the middle of the bar
UPRIGHT_COS, STILL_M_S = math.cos(math.radians(20.0)), 0.05
AWAY_M, SLOW_M_S = 0.25, 0.15  # of the tool over the bar once it has flown off, and how slow it is there
PERCH_LOW, PERCH_HIGH = np.array([-0.25, -0.25, 0.5]), np.array([0.25, 0.25, 0.7])
YAW_RAD = np.deg2rad(60.0)
START_LOW, START_HIGH = np.array([-0.3, -0.3, 1.1]), np.array([0.3, 0.3, 1.3])
PERCH = BASE = ANYTHING = 0  # site; joint; contact sensor
# What is remembered: for how many steps it has been perched, 1 once they were enough, what the rotors give.
STEPS, DONE, SHARE = range(3)


class Perch(Task):
    """It has stood on the bar for 5 s, held by its gripper, rotors at rest; then it hovers higher than the bar for 1 s.

    It stands: both fingers squeeze the bar between them, with at least 3 N each, within 15 cm of its middle; the thrust
    that its rotors really give is below a fifth of its weight; it is slower than 5 cm/s and within 20° of upright;
    nothing but the gripper touches anything. Five seconds count in one piece.

    It hovers: nothing of it touches anything, slower than 15 cm/s, the tool at least 25 cm above the bar.
    """

    name = "perch"
    grade = "medium"
    instruction = "Grip the bar, stop the rotors and stand on it for five seconds; then let go and fly off."
    wordings = (
        "Perch on the bar with the rotors stopped, then take off again.",
        "Stand on the wooden bar for five seconds, held by the gripper, and fly off.",
        "抓住横杆，停转旋翼，站立五秒，然后松开飞走。",
        "栖停在横杆上，五秒后再起飞。",
    )
    held_out = ("Land on the bar, hold on for five seconds with the rotors off, and leave.", "请停在木杆上再飞走。")
    time_limit_s = 40.0
    dwell_s = 1.0
    subtasks = ("over_bar", "clamped", "rotors_down", "perched", "away")
    names = Names(sites=("perch",), joints=("base",), contacts=("robot_touch",))
    force_sensors = ("grip_left", "grip_right")

    def own_infeasibility(self, robot: Robot) -> str | None:
        opening, needed = 2.0 * robot.gripper.stroke, 3.0 * BAR_HALF_M[1]
        if opening < needed:
            return f"its gripper opens {100 * opening:.1f} cm, the bar needs {100 * needed:.1f} cm"
        return infeasible_standing(robot)

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_perch(spec)
        add_touch_sensor(spec, "robot_touch")
        for side in ("left", "right"):
            add_force_sensor(spec, f"grip_{side}", f"finger_{side}", on="perch")

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        view.task_state[world, SHARE] = 1.0
        place(view, world, "perch", rng.uniform(PERCH_LOW, PERCH_HIGH), yaw=rng.uniform(-YAW_RAD, YAW_RAD))

    def fields(self) -> tuple[Field, ...]:
        own = {"frame": "", "noise": EXACT, "onboard": True}
        return (
            seen("perch_pos", "middle of the bar"),
            direction("perch_yaw", "of twice the yaw of the bar", labels=("cos2", "sin2")),
            seen("tool_to_perch", "from the tool to it"),
            seen("thrust_share", "rotors, of the weight", 1, unit="", labels=("now",), **own),
            seen("perched_s", "how long it has been perched; 5 once it may go", 1, unit="s", **own),
        )


@kernel
def observe(world, found):
    mat, bar = site_mat(world, PERCH), site_pos(world, PERCH)
    put(found, 0, bar)
    found[3], found[4] = mat[0] * mat[0] - mat[3] * mat[3], 2.0 * mat[0] * mat[3]
    put(found, 5, sub(bar, tool_pos(world)))
    found[8], found[9] = task_state(world)[SHARE], perched_s(world)


@kernel
def remember(world):
    """Count the control steps for which it has been perched, and note the thrust."""
    state = task_state(world)
    state[SHARE] = thrust_share(world)
    state[STEPS] = state[STEPS] + 1.0 if perching(world) else 0.0
    if state[STEPS] >= ENOUGH_STEPS:
        state[DONE] = 1.0


@kernel
def solved(world):
    return task_state(world)[DONE] > 0.0 and away(world)


@kernel
def progress(world, flags):
    flags[0], flags[1] = planar_norm(offset(world)) <= 0.05, clamped(world)
    flags[2], flags[3] = clamped(world) and thrust_share(world) <= LET_GO_SHARE, task_state(world)[DONE] > 0.0
    flags[4] = flags[3] > 0.0 and away(world)


@kernel
def reward(world):
    height = offset(world)[2]
    if task_state(world)[DONE] > 0.0:
        return 0.8 + 0.2 * clip(height / AWAY_M, 0.0, 1.0)
    near = 0.1 * closeness(norm(offset(world)), 0.3) + 0.1 * closeness(norm(offset(world)), 0.05)
    if not clamped(world):
        return near
    return 0.3 + 0.2 * clip(1.0 - thrust_share(world), 0.0, 1.0) + 0.3 * perched_s(world) / PERCHED_S


@kernel
def offset(world):
    """Of the tool from the middle of the bar: along it, across it, up, m."""
    mat, away_from = site_mat(world, PERCH), sub(tool_pos(world), site_pos(world, PERCH))
    return (dot(column(mat, 0), away_from), dot(column(mat, 1), away_from), away_from[2])


@kernel
def thrust_share(world):
    """What the rotors give now, all their thrusts added up, as a share of the weight."""
    thrust, total = rotor_thrust(world, world.num_rotors), 0.0
    for i in range(thrust.size):
        total += abs(thrust[i])
    return total / world.weight


@kernel
def perched_s(world):
    """How long it has been perched without a break, s; ``PERCHED_S`` once that was long enough."""
    state = task_state(world)
    return PERCHED_S if state[DONE] > 0.0 else CONTROL_DT_S * state[STEPS]


@kernel
def clamped(world):
    """Whether the bar is between the fingers and both squeeze it."""
    place_, side = offset(world), column(tool_mat(world), 1)
    between = abs(place_[0]) <= ALONG_M and abs(place_[1]) <= BESIDE_M and abs(place_[2]) <= REACH_M
    closed = 2.0 * world.stroke * gripper_opening(world) <= 2.0 * BAR_HALF_M[1] + GRIP_SLACK_M
    left, right = -dot(side, force(world, 0)), dot(side, force(world, 1))
    return between and closed and min(left, right) >= SQUEEZE_N


@kernel
def perching(world):
    """Whether it stands on the bar at this moment, held, with its rotors down."""
    still = norm(free_vel(world, BASE)) <= STILL_M_S and base_mat(world)[8] >= UPRIGHT_COS
    return clamped(world) and thrust_share(world) <= LET_GO_SHARE and still and untouched(world)


@kernel
def away(world):
    """Whether it hovers higher than the bar and touches nothing."""
    slow = norm(free_vel(world, BASE)) <= SLOW_M_S
    return offset(world)[2] >= AWAY_M and slow and not touching(world, ANYTHING)


TASK = Perch(TaskKernels(observe=observe, solved=solved, progress=progress, reward=reward, remember=remember))
