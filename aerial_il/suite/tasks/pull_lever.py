"""Pull a lever: hook its crossbar from behind and pull it over, against a spring."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.control.dynamics import put
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import clip, closeness, column, norm, planar_norm, scale, sub
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.feasibility import infeasible_pulling
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import Names, joint_pos, joint_vel, site_mat, site_pos, tip_pos, untouched
from aerial_il.suite.props.lever import (
    BAR_HALF_M,
    LEVER_DAMPING,
    LEVER_FRICTION_NM,
    LEVER_M,
    LEVER_SPRING_NM_RAD,
    LEVER_STOP_RAD,
    add_lever,
)
from aerial_il.suite.props.place import place
from aerial_il.suite.tasks.fields import direction, seen
from aerial_il.suite.tasks.task import Task, TaskKernels, hover_start

PULLED_RAD = np.deg2rad(55.0)
SWING_RAD_S = 0.8  # a sensible speed to pull it over
START_ANGLE_RAD = (0.0, np.deg2rad(10.0))  # from here it is at least 45° to PULLED_RAD; friction holds it there
STOP_GIVE_RAD = 0.1
BEHIND_M = 0.05  # where the fingers are ready to go down behind the bar
NEAR_M, REACH_M = 0.03, 0.12  # of that point; behind the bar and still of use
LEVER_LOW, LEVER_HIGH = np.array([-0.25, -0.3, 0.22]), np.array([0.25, 0.3, 0.33])
YAW_RAD = (2 * np.pi / 3, 4 * np.pi / 3)  # of the pull: towards the robot, that comes round by up to 60°
START_LOW, START_HIGH = np.array([-0.25, -0.3, 1.2]), np.array([0.3, 0.2, 1.33])
BAR, PIVOT = range(2)  # sites
LEVER = 0  # joint


class PullLever(Task):
    """Lever pulled over by at least 45° and held for 0.5 s, against a spring that takes it back, and dry friction.

    Pulled over: at the green pin, 55° from where the lever rests, or beyond it as far as the stop at 80°, which yields
    by up to 6°.
    """

    name = "pull_lever"
    grade = "medium"
    instruction = "Hook the orange bar from behind and pull the lever over to the green pin."
    wordings = (
        "Pull the lever to the green pin by its orange bar.",
        "Hook the bar of the lever and pull it over.",
        "钩住橙色横杆，把拉杆拉到绿色销处。",
        "把拉杆拉过来。",
    )
    held_out = ("Pull the orange bar until the lever is at the green pin.", "请拉下拉杆。")
    time_limit_s = 25.0
    dwell_s = 0.5
    subtasks = ("behind_bar", "hooked", "half_way", "pulled")
    names = Names(sites=("bar", "lever"), joints=("lever",))

    def own_infeasibility(self, robot: Robot) -> str | None:
        torque = LEVER_FRICTION_NM + LEVER_SPRING_NM_RAD * PULLED_RAD + LEVER_DAMPING * SWING_RAD_S
        return infeasible_pulling(robot, torque / LEVER_M)

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_lever(spec, PULLED_RAD)

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        place(view, world, "lever_mount", rng.uniform(LEVER_LOW, LEVER_HIGH), yaw=rng.uniform(*YAW_RAD))
        angle, _ = view.joint("lever")
        angle[world] = rng.uniform(*START_ANGLE_RAD)

    def fields(self) -> tuple[Field, ...]:
        return (
            seen("lever_pos", "the lever's pivot"),
            direction("pull_direction", "in which it is to be pulled"),
            seen("lever_angle", "of the lever; 0 at the start", 1, unit="rad", frame="about the pivot"),
            seen("lever_rate", "its rate", 1, unit="rad/s", frame="about the pivot"),
            seen("bar_pos", "middle of the bar that the gripper hooks from behind"),
            seen("tip_to_bar", "from the fingertips to the bar"),
        )


@kernel
def observe(world, found):
    bar, mat = site_pos(world, BAR), site_mat(world, PIVOT)
    put(found, 0, site_pos(world, PIVOT))
    found[3], found[4] = mat[0], mat[3]
    found[5], found[6] = joint_pos(world, LEVER), joint_vel(world, LEVER)
    put(found, 7, bar)
    put(found, 10, sub(bar, tip_pos(world)))


@kernel
def solved(world):
    return pulled(world) and untouched(world)


@kernel
def progress(world, flags):
    angle = joint_pos(world, LEVER)
    flags[0] = planar_norm(sub(behind_bar(world), tip_pos(world))) <= NEAR_M
    flags[1], flags[2], flags[3] = hooked(world), angle >= 0.5 * PULLED_RAD, pulled(world)


@kernel
def reward(world):
    near = closeness(norm(sub(behind_bar(world), tip_pos(world))), 0.15)
    share = clip(joint_pos(world, LEVER) / PULLED_RAD, 0.0, 1.0)
    return 0.25 * near + (0.1 if hooked(world) else 0.0) + 0.65 * share


@kernel
def pulled(world):
    """Whether the lever is at the pin, or between it and the stop."""
    return PULLED_RAD <= joint_pos(world, LEVER) <= LEVER_STOP_RAD + STOP_GIVE_RAD


@kernel
def hooked(world):
    """Whether the fingertips are below the bar and behind it."""
    offset, mat = sub(tip_pos(world), site_pos(world, BAR)), site_mat(world, PIVOT)
    along = offset[0] * mat[0] + offset[1] * mat[3]
    aside = offset[0] * mat[1] + offset[1] * mat[4]
    return offset[2] <= 0.0 and -REACH_M <= along <= 0.0 and abs(aside) <= BAR_HALF_M


@kernel
def behind_bar(world):
    """Point where the fingertips are ready to pull: behind the middle of the bar, world frame, m."""
    return sub(site_pos(world, BAR), scale(BEHIND_M, column(site_mat(world, PIVOT), 0)))


TASK = PullLever(TaskKernels(observe=observe, solved=solved, progress=progress, reward=reward))
