"""Push a slider along its rail, to the end."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.core.arrays import closeness, length
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.abilities import obstacle_to_pulling
from aerial_il.suite.contact_sensors import GRIPPER, add_force_sensor
from aerial_il.suite.props.place import place
from aerial_il.suite.props.slider import FRICTION_N, RAIL_M, add_slider
from aerial_il.suite.tasks.task import Task, hover_start
from aerial_il.suite.view import View

DONE_SHARE = 0.9  # of the rail
STOP_GIVE_M = 0.01  # beyond the stop a carriage is off its rail
BEHIND_M = 0.05  # where the gripper is ready to push
READY_M = 0.03
RAIL_LOW, RAIL_HIGH = np.array([-0.2, -0.3, 0.40]), np.array([0.2, 0.3, 0.60])
START_SHARE = (0.0, 0.1)  # of the rail, where the carriage stands at first
START_LOW, START_HIGH = np.array([-0.25, -0.3, 1.35]), np.array([0.3, 0.2, 1.5])


class PushSlider(Task):
    """Carriage within the last tenth of its rail for 0.5 s; the rail points anywhere, its far end is marked green.

    At the end: from 90 % of the way between the stops to 1 cm beyond the far one, which yields.
    """

    name = "push_slider"
    grade = "easy"
    instruction = "Push the orange handle along its rail to the green end."
    time_limit_s = 25.0
    dwell_s = 0.5
    subtasks = ("at_handle", "moving", "half_way", "at_end")
    force_sensors = ("tool_force",)

    def obstacle_to(self, robot: Robot) -> str | None:
        return obstacle_to_pulling(robot, FRICTION_N)

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_slider(spec)
        add_force_sensor(spec, "tool_force", GRIPPER)

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        place(view, world, "rail", rng.uniform(RAIL_LOW, RAIL_HIGH), yaw=rng.uniform(-np.pi, np.pi))
        travel, _ = view.joint("slider")
        travel[world] = RAIL_M * rng.uniform(*START_SHARE)

    def fields(self) -> tuple[Field, ...]:
        xyz = ("x", "y", "z")
        return (
            Field("handle_pos", (3,), "task", unit="m", labels=xyz),
            Field("rail_direction", (2,), "task", labels=("x", "y")),
            Field("slider_travel", (1,), "task", unit="m"),
            Field("slider_speed", (1,), "task", unit="m/s"),
            Field("tip_to_handle", (3,), "task", unit="m", labels=xyz),
            Field("handle_to_end", (3,), "task", unit="m", labels=xyz),
            Field("tool_force", (3,), "task", unit="N", labels=xyz),
        )

    def observe(self, view: View) -> dict[str, np.ndarray]:
        handle, (travel, speed) = view.site_pos("slider"), view.joint("slider")
        return {
            "handle_pos": handle.copy(),
            "rail_direction": view.site_mat("slider")[:, 0:6:3].copy(),
            "slider_travel": travel[:, None].copy(),
            "slider_speed": speed[:, None].copy(),
            "tip_to_handle": handle - view.tip_pos,
            "handle_to_end": view.site_pos("rail_end") - handle,
            "tool_force": view.force().copy(),
        }

    def solved(self, view: View) -> np.ndarray:
        return at_end(view.joint("slider")[0]) & (view.unwanted_contacts == 0)

    def progress(self, view: View) -> np.ndarray:
        travel, speed = view.joint("slider")
        share = travel / RAIL_M
        at_handle = length(ready_point(view) - view.tip_pos) <= READY_M
        return np.stack([at_handle, speed >= 0.02, share >= 0.5, at_end(travel)], axis=1)

    def reward(self, view: View) -> np.ndarray:
        distance = length(ready_point(view) - view.tip_pos)
        near = 0.6 * closeness(distance, 0.15) + 0.4 * closeness(distance, 0.04)
        done = np.clip(view.joint("slider")[0] / (DONE_SHARE * RAIL_M), 0.0, 1.0)
        return 0.35 * near * (1.0 - done) + 0.9 * done


def at_end(travel: np.ndarray) -> np.ndarray:
    """(n,) bool for travels (n,), m: the carriage is on the last tenth of its rail."""
    return (travel >= DONE_SHARE * RAIL_M) & (travel <= RAIL_M + STOP_GIVE_M)


def ready_point(view: View) -> np.ndarray:
    """(n, 3) where the fingertips are ready to push: behind the handle's middle, world, m."""
    return view.site_pos("slider") - BEHIND_M * view.site_mat("slider")[:, 0::3]


TASK = PushSlider()
