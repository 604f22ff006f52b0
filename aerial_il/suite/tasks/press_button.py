"""Press a button: push its cap in far enough, and never hard."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.control.dynamics import put
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import clip, closeness, norm, sub
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.feasibility import infeasible_gentleness
from aerial_il.suite.physics.contact_sensors import CONTACT_ALONE, GRIPPER, ROBOT, add_force_sensor
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import (
    Names,
    force,
    joint_pos,
    peak_force,
    put_rot6d,
    site_mat,
    site_pos,
    tip_pos,
    untouched,
)
from aerial_il.suite.props.button import HOUSING_HALF_M, TRAVEL_M, add_button
from aerial_il.suite.props.place import place
from aerial_il.suite.tasks.fields import EXACT, seen, wrist_force
from aerial_il.suite.tasks.task import Task, TaskKernels, hover_start

PRESSED_M, DEEPEST_M = 0.008, TRAVEL_M + 0.001
LEAST_FORCE_N = 0.5  # of the robot on the button; the spring gives 1.3 N where it counts as pressed
PEAK_FORCE_N = 15.0
AT_BUTTON_M = 0.03
BUTTON_LOW, BUTTON_HIGH = np.array([-0.25, -0.35, 0.45]), np.array([0.25, 0.35, 0.65])
TILT_RANGE_RAD = (0.0, 0.45)
YAW_RANGE_RAD = (-1.0, 1.0)
START_LOW, START_HIGH = np.array([-0.25, -0.3, 1.35]), np.array([0.3, 0.2, 1.5])
BUTTON = 0  # site and joint
BY_ROBOT, BY_TOOL = range(2)  # whose force


class PressButton(Task):
    """Cap pressed in by the robot by at least 8 mm for 0.3 s; its net contact force has never exceeded 15 N.

    Pressed in: by 8 to 21 mm (the stop at 20 mm yields), with a force of the robot of at least 0.5 N. The force is the
    net contact force of all parts of the robot, sampled at each physics step (250 Hz) behind a first-order low-pass of
    15 Hz, as in force sensors (``suite/physics/force_sensing.py`` gives the source); its largest sample counts. The
    unfiltered force may be larger for some milliseconds. Links and rotors must not touch anything.

    The button leans back by up to 26°, so that it is pressed from above or at a slant.
    """

    name = "press_button"
    grade = "easy"
    instruction = "Press the red button gently and keep it pressed."
    wordings = ("Push the red button down.", "Press the button on the pedestal.", "按下红色按钮。", "把按钮按下去。")
    held_out = ("Press down the red button.", "请按红色的按钮。")
    time_limit_s = 20.0
    dwell_s = 0.3
    subtasks = ("at_button", "touched", "half_pressed", "pressed", "gentle")
    once_lost = ("gentle",)
    names = Names(sites=("button",), joints=("button",))
    force_sensors = ("robot_force", "tool_force")
    privileged = (
        ("button_travel", "a button has no travel sensor, and the fingers hide it from cameras"),
        ("tool_force", CONTACT_ALONE),
        ("peak_force", "the force of all parts of the robot, without sensor noise"),
    )

    def own_infeasibility(self, robot: Robot) -> str | None:
        return infeasible_gentleness(robot, PEAK_FORCE_N)

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_button(spec)
        add_force_sensor(spec, "robot_force", ROBOT)
        add_force_sensor(spec, "tool_force", GRIPPER)

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        pos, yaw, tilt = rng.uniform(BUTTON_LOW, BUTTON_HIGH), rng.uniform(*YAW_RANGE_RAD), rng.uniform(*TILT_RANGE_RAD)
        place(view, world, "button", pos, yaw=yaw, pitch=-tilt)
        place(view, world, "button_stand", pos - [0.0, 0.0, HOUSING_HALF_M[2]])

    def fields(self) -> tuple[Field, ...]:
        return (
            seen("button_pos", "middle of the cap"),
            seen("button_rot6d", "first two columns of the button's rotation", 6, unit="", frame="world from button"),
            seen("button_travel", "how far the cap is pressed in", 1, frame="along the button", real=False),
            seen("tip_to_button", "from the fingertips to the cap"),
            wrist_force("tool_force"),
            seen(
                "peak_force",
                "largest force of the whole robot on the button so far",
                1,
                unit="N",
                frame="",
                noise=EXACT,
                real=False,
            ),
        )


@kernel
def observe(world, found):
    button = site_pos(world, BUTTON)
    put(found, 0, button)
    put_rot6d(found, 3, site_mat(world, BUTTON))
    found[9] = joint_pos(world, BUTTON)
    put(found, 10, sub(button, tip_pos(world)))
    put(found, 13, force(world, BY_TOOL))
    found[16] = peak_force(world, BY_ROBOT)


@kernel
def solved(world):
    return pressed(world) and gentle(world) and untouched(world)


@kernel
def progress(world, flags):
    travel = joint_pos(world, BUTTON)
    flags[0] = norm(sub(site_pos(world, BUTTON), tip_pos(world))) <= AT_BUTTON_M
    flags[1], flags[2], flags[3] = travel >= 0.1 * PRESSED_M, travel >= 0.5 * PRESSED_M, pressed(world)
    flags[4] = gentle(world)


@kernel
def reward(world):
    distance = norm(sub(site_pos(world, BUTTON), tip_pos(world)))
    near = 0.6 * closeness(distance, 0.15) + 0.4 * closeness(distance, 0.03)
    share = clip(joint_pos(world, BUTTON) / PRESSED_M, 0.0, 1.0)
    return (0.5 * near + 0.5 * share) * (1.0 if gentle(world) else 0.5)


@kernel
def pressed(world):
    """Whether the robot has pressed the cap in far enough."""
    return PRESSED_M <= joint_pos(world, BUTTON) <= DEEPEST_M and norm(force(world, BY_ROBOT)) >= LEAST_FORCE_N


@kernel
def gentle(world):
    """Whether no contact has been too hard so far."""
    return peak_force(world, BY_ROBOT) <= PEAK_FORCE_N


TASK = PressButton(TaskKernels(observe=observe, solved=solved, progress=progress, reward=reward))
