"""Press a button: push its cap in far enough, and never hard."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.core.arrays import closeness, length
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.abilities import obstacle_to_gentleness
from aerial_il.suite.contact_sensors import GRIPPER, ROBOT, add_force_sensor
from aerial_il.suite.props.button import HOUSING_HALF_M, TRAVEL_M, add_button
from aerial_il.suite.props.place import place
from aerial_il.suite.tasks.task import Task, hover_start
from aerial_il.suite.view import View

PRESSED_M, DEEPEST_M = 0.008, TRAVEL_M + 0.001
LEAST_FORCE_N = 0.5  # of the robot on the button; the spring gives 1.3 N where it counts as pressed
PEAK_FORCE_N = 15.0
TOOL = 1  # which force is the tool's alone
AT_BUTTON_M = 0.03
BUTTON_LOW, BUTTON_HIGH = np.array([-0.25, -0.35, 0.45]), np.array([0.25, 0.35, 0.65])
TILT_RANGE_RAD = (0.0, 0.45)
YAW_RANGE_RAD = (-1.0, 1.0)
START_LOW, START_HIGH = np.array([-0.25, -0.3, 1.35]), np.array([0.3, 0.2, 1.5])


class PressButton(Task):
    """Cap pressed in by at least 8 mm, by the robot, for 0.3 s; the robot has never exerted more than 15 N on anything.

    Pressed in: from 8 to 21 mm, the stop being at 20 and yielding, by a force of the robot of at least 0.5 N. The force
    is the net force of all contacts of all its parts, taken at each physics step (250 Hz) behind a first-order low-pass
    of 15 Hz, as force sensors have (``suite/force_sensing.py`` gives the source): that the largest is remembered from.
    Without the filter it may be larger for some milliseconds. Links and rotors must not touch anything.

    The button leans back by up to 26°, so that it is pressed from above or at a slant.
    """

    name = "press_button"
    grade = "easy"
    instruction = "Press the red button gently and keep it pressed."
    time_limit_s = 20.0
    dwell_s = 0.3
    subtasks = ("at_button", "touched", "half_pressed", "pressed", "gentle")
    force_sensors = ("robot_force", "tool_force")

    def obstacle_to(self, robot: Robot) -> str | None:
        return obstacle_to_gentleness(robot, PEAK_FORCE_N)

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
        xyz = ("x", "y", "z")
        return (
            Field("button_pos", (3,), "task", unit="m", labels=xyz),
            Field("button_rot6d", (6,), "task"),
            Field("button_travel", (1,), "task", unit="m"),
            Field("tip_to_button", (3,), "task", unit="m", labels=xyz),
            Field("tool_force", (3,), "task", unit="N", labels=xyz),
            Field("peak_force", (1,), "task", unit="N"),
        )

    def observe(self, view: View) -> dict[str, np.ndarray]:
        button = view.site_pos("button")
        return {
            "button_pos": button.copy(),
            "button_rot6d": view.site_rot6d("button"),
            "button_travel": view.joint("button")[0][:, None].copy(),
            "tip_to_button": button - view.tip_pos,
            "tool_force": view.force(TOOL).copy(),
            "peak_force": view.peak_force()[:, None].copy(),
        }

    def solved(self, view: View) -> np.ndarray:
        return self._pressed(view) & self._gentle(view) & (view.unwanted_contacts == 0)

    def progress(self, view: View) -> np.ndarray:
        near = length(view.site_pos("button") - view.tip_pos) <= AT_BUTTON_M
        travel, _ = view.joint("button")
        touched, half = travel >= 0.1 * PRESSED_M, travel >= 0.5 * PRESSED_M
        return np.stack([near, touched, half, self._pressed(view), self._gentle(view)], axis=1)

    def reward(self, view: View) -> np.ndarray:
        distance = length(view.site_pos("button") - view.tip_pos)
        near = 0.6 * closeness(distance, 0.15) + 0.4 * closeness(distance, 0.03)
        pressed = np.clip(view.joint("button")[0] / PRESSED_M, 0.0, 1.0)
        return (0.5 * near + 0.5 * pressed) * np.where(self._gentle(view), 1.0, 0.5)

    def _pressed(self, view: View) -> np.ndarray:
        travel, _ = view.joint("button")
        return (travel >= PRESSED_M) & (travel <= DEEPEST_M) & (length(view.force()) >= LEAST_FORCE_N)

    def _gentle(self, view: View) -> np.ndarray:
        return view.peak_force() <= PEAK_FORCE_N


TASK = PressButton()
