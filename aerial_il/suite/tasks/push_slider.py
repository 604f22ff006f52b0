"""Push a slider along its rail, to the end."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.control.dynamics import put
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import clip, closeness, column, norm, scale, sub
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.feasibility import infeasible_pulling
from aerial_il.suite.physics.contact_sensors import CONTACT_ALONE, GRIPPER, add_force_sensor
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import Names, force, joint_pos, joint_vel, site_mat, site_pos, tip_pos, untouched
from aerial_il.suite.props.place import place
from aerial_il.suite.props.slider import FRICTION_N, RAIL_M, add_slider
from aerial_il.suite.tasks.fields import direction, seen, wrist_force
from aerial_il.suite.tasks.task import Task, TaskKernels, hover_start

DONE_SHARE = 0.9  # of the rail
STOP_GIVE_M = 0.01  # beyond the stop a carriage is off its rail
BEHIND_M = 0.05  # where the gripper is ready to push
READY_M = 0.03
RAIL_LOW, RAIL_HIGH = np.array([-0.2, -0.3, 0.40]), np.array([0.2, 0.3, 0.60])
START_SHARE = (0.0, 0.1)  # of the rail, where the carriage stands at first
START_LOW, START_HIGH = np.array([-0.25, -0.3, 1.35]), np.array([0.3, 0.2, 1.5])
SLIDER, RAIL_END = range(2)  # sites; the slider is the joint too


class PushSlider(Task):
    """Carriage within the last tenth of its rail for 0.5 s; the rail has a random direction, its far end is green.

    At the end: from 90 % of the way between the stops to 1 cm beyond the far one, which yields.
    """

    name = "push_slider"
    grade = "easy"
    instruction = "Push the orange handle along its rail to the green end."
    wordings = (
        "Slide the orange handle to the green end of the rail.",
        "Push the handle along the rail, all the way.",
        "把橙色手柄沿导轨推到绿色的一端。",
        "把手柄推到头。",
    )
    held_out = ("Move the orange handle along its rail to the green end.", "请把手柄推到绿色的一端。")
    time_limit_s = 25.0
    dwell_s = 0.5
    subtasks = ("at_handle", "moving", "half_way", "at_end")
    names = Names(sites=("slider", "rail_end"), joints=("slider",))
    force_sensors = ("tool_force",)
    privileged = (("tool_force", CONTACT_ALONE),)

    def own_infeasibility(self, robot: Robot) -> str | None:
        return infeasible_pulling(robot, FRICTION_N)

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_slider(spec)
        add_force_sensor(spec, "tool_force", GRIPPER)

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        place(view, world, "rail", rng.uniform(RAIL_LOW, RAIL_HIGH), yaw=rng.uniform(-np.pi, np.pi))
        travel, _ = view.joint("slider")
        travel[world] = RAIL_M * rng.uniform(*START_SHARE)

    def fields(self) -> tuple[Field, ...]:
        return (
            seen("handle_pos", "middle of the handle"),
            direction("rail_direction", "in which the handle is to be pushed"),
            seen("slider_travel", "how far the handle is along its rail", 1, frame="along the rail"),
            seen("slider_speed", "its speed", 1, unit="m/s", frame="along the rail"),
            seen("tip_to_handle", "from the fingertips to the handle"),
            seen("handle_to_end", "from the handle to the end of its way"),
            wrist_force("tool_force"),
        )


@kernel
def observe(world, found):
    handle, mat = site_pos(world, SLIDER), site_mat(world, SLIDER)
    put(found, 0, handle)
    found[3], found[4] = mat[0], mat[3]
    found[5], found[6] = joint_pos(world, SLIDER), joint_vel(world, SLIDER)
    put(found, 7, sub(handle, tip_pos(world)))
    put(found, 10, sub(site_pos(world, RAIL_END), handle))
    put(found, 13, force(world, 0))


@kernel
def solved(world):
    return at_end(world) and untouched(world)


@kernel
def progress(world, flags):
    share = joint_pos(world, SLIDER) / RAIL_M
    flags[0] = norm(sub(ready_point(world), tip_pos(world))) <= READY_M
    flags[1], flags[2], flags[3] = joint_vel(world, SLIDER) >= 0.02, share >= 0.5, at_end(world)


@kernel
def reward(world):
    distance = norm(sub(ready_point(world), tip_pos(world)))
    near = 0.6 * closeness(distance, 0.15) + 0.4 * closeness(distance, 0.04)
    done = clip(joint_pos(world, SLIDER) / (DONE_SHARE * RAIL_M), 0.0, 1.0)
    return 0.35 * near * (1.0 - done) + 0.9 * done


@kernel
def at_end(world):
    """Whether the carriage is on the last tenth of its rail."""
    return DONE_SHARE * RAIL_M <= joint_pos(world, SLIDER) <= RAIL_M + STOP_GIVE_M


@kernel
def ready_point(world):
    """Point where the fingertips are ready to push: behind the handle's middle, world frame, m."""
    return sub(site_pos(world, SLIDER), scale(BEHIND_M, column(site_mat(world, SLIDER), 0)))


TASK = PushSlider(TaskKernels(observe=observe, solved=solved, progress=progress, reward=reward))
