"""Assemble a frame: take a beam off its supports and lay it into two hooks that are 3 mm wider."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from aerial_il.control.dynamics import put
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import clip, closeness, column, norm, planar_norm, rotate_back, sub
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.feasibility import infeasible_upright_hold
from aerial_il.suite.physics.contact_sensors import (
    CONTACT_ALONE,
    GRIPPER,
    add_contact_sensor,
    add_force_sensor,
    add_touch_sensor,
)
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import Names, force, free_vel, site_mat, site_pos, tool_pos, touching, untouched
from aerial_il.suite.props import FALLEN_M, TABLE_HEIGHT_M, add_table
from aerial_il.suite.props.frame import BEAM_HALF_M, FLOOR_M, HOOK_M, add_beam, add_frame, add_supports
from aerial_il.suite.props.place import place, two_places
from aerial_il.suite.tasks.fields import direction, seen, wrist_force
from aerial_il.suite.tasks.task import Task, TaskKernels, hover_start

BESIDE_M, OVER_FLOOR_M, ALONG_M = 0.002, 0.002, 0.03  # of the beam's axis in each hook; of its middle along the frame
UPRIGHT_COS = math.cos(math.radians(10.0))
AT_REST_M_S = 0.05
CLEAR_OF_BEAM_M = 0.08
LIFTED_M = 0.04
OVER_FRAME_M, ALIGNED_RAD = 0.02, 0.1
ROOM_FOR_ERRORS_M = 0.03  # between beam and open fingers, together
AREA_LOW, AREA_HIGH = np.array([-0.20, -0.26]), np.array([0.20, 0.26])
APART_M = 0.36
START_LOW, START_HIGH = np.array([-0.3, -0.3, 1.15]), np.array([0.3, 0.3, 1.35])
BEAM, FRAME = range(2)  # sites; the beam is the first joint too
GRIP_LEFT, GRIP_RIGHT, ROBOT_ON_BEAM = range(3)  # contacts


class AssembleFrame(Task):
    """Beam in both hooks of the frame, let go of and slower than 5 cm/s, gripper at least 8 cm away, for 0.5 s.

    The beam is 20 mm square and 34 cm long, the hooks are 23 mm wide, 27 mm between the edges of their walls, and 26 cm
    apart. In a hook: where it crosses the middle of the hook, the beam's axis is at most 2 mm beside the hook's, and
    within 2 mm of the height at which it lies on its floor. The beam's middle is at most 3 cm from the frame's, so that
    both ends stick out; its striped face, which is up on the supports, is up, within 10°. Either end may be in either
    hook. Let go of: no part of the robot touches it; links and rotors touch nothing.

    A beam whose middle is more than 10 cm below the table's surface, on the floor or on its way there, and that is not
    in the gripper is lost: the episode ends as dropped.
    """

    name = "assemble_frame"
    grade = "hard"
    instruction = "Take the orange beam off its supports and lay it into both blue hooks."
    wordings = (
        "Lift the orange beam from the supports and lower it onto the two hooks.",
        "Lay the beam into both hooks of the frame, stripe up.",
        "把橙色横梁从支架上取下，放进两个蓝色挂钩。",
        "抬起横梁，放入两个挂钩里。",
    )
    held_out = ("Put the orange beam into the two blue hooks.", "请把横梁放到两个挂钩里。")
    time_limit_s = 45.0
    dwell_s = 0.5
    subtasks = ("at_beam", "grasped", "lifted", "over_frame", "in_one_hook", "in_both_hooks")
    names = Names(sites=("beam", "frame"), joints=("beam",), contacts=("grip_left", "grip_right", "robot_on_beam"))
    force_sensors = ("wrist_force",)
    privileged = (("wrist_force", CONTACT_ALONE),)

    def own_infeasibility(self, robot: Robot) -> str | None:
        opening, needed = 2.0 * robot.gripper.stroke, 2.0 * BEAM_HALF_M[1] + ROOM_FOR_ERRORS_M
        if opening < needed:
            return f"its gripper opens {100 * opening:.1f} cm, the beam needs {100 * needed:.1f} cm"
        return infeasible_upright_hold(robot)

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_table(spec)
        add_beam(spec)
        add_supports(spec)
        add_frame(spec)
        for side in ("left", "right"):
            add_contact_sensor(spec, f"grip_{side}", geoms=(f"pad_{side}", "beam"))
        add_touch_sensor(spec, "robot_on_beam", "beam")
        add_force_sensor(spec, "wrist_force", GRIPPER)

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        supports, frame = two_places(rng, AREA_LOW, AREA_HIGH, apart=APART_M)
        lying, hooks = (_side_on(rng, frame - supports) for _ in range(2))
        place(view, world, "supports", np.array([*supports, TABLE_HEIGHT_M]), yaw=lying)
        place(view, world, "frame", np.array([*frame, TABLE_HEIGHT_M]), yaw=hooks)
        pose, _ = view.free_joint("beam")
        height = TABLE_HEIGHT_M + FLOOR_M + BEAM_HALF_M[2]
        view.qpos[world, pose] = [*supports, height, np.cos(0.5 * lying), 0.0, 0.0, np.sin(0.5 * lying)]

    def fields(self) -> tuple[Field, ...]:
        return (
            seen("beam_pos", "middle of the beam"),
            direction("beam_heading", "of twice its yaw, the same for both ends", labels=("cos2", "sin2")),
            seen("frame_pos", "where the beam's middle is when it lies in both hooks"),
            direction("frame_heading", "of twice the frame's yaw", labels=("cos2", "sin2")),
            seen("tool_to_beam", "from the tool to the middle of the beam"),
            seen("beam_to_frame", "from the beam's middle to where it is to be"),
            seen("beam_turn", "by which the beam is to be turned, within ±90°", 1, unit="rad", frame="about z"),
            wrist_force(),
        )


@kernel
def observe(world, found):
    beam, frame = site_pos(world, BEAM), site_pos(world, FRAME)
    put(found, 0, beam)
    found[3], found[4] = doubled_heading(world, BEAM)
    put(found, 5, frame)
    found[8], found[9] = doubled_heading(world, FRAME)
    put(found, 10, sub(beam, tool_pos(world)))
    put(found, 13, sub(frame, beam))
    found[16] = beam_turn(world)
    put(found, 17, force(world, 0))


@kernel
def solved(world):
    clear = norm(sub(site_pos(world, BEAM), tool_pos(world))) >= CLEAR_OF_BEAM_M
    slow = norm(free_vel(world, BEAM)) <= AT_REST_M_S
    return assembled(world) and slow and clear and not touching(world, ROBOT_ON_BEAM) and untouched(world)


@kernel
def lost(world):
    return site_pos(world, BEAM)[2] < TABLE_HEIGHT_M - FALLEN_M and not grasped(world)


@kernel
def progress(world, flags):
    beam, held = site_pos(world, BEAM), grasped(world)
    lifted = held and beam[2] >= TABLE_HEIGHT_M + FLOOR_M + BEAM_HALF_M[2] + LIFTED_M
    near = planar_norm(sub(beam, site_pos(world, FRAME))) <= OVER_FRAME_M and abs(beam_turn(world)) <= ALIGNED_RAD
    flags[0], flags[1], flags[2], flags[3] = norm(sub(beam, tool_pos(world))) <= 0.03, held, lifted, held and near
    flags[4], flags[5] = in_hook(world, -HOOK_M) or in_hook(world, HOOK_M), assembled(world)


@kernel
def reward(world):
    beam, frame = site_pos(world, BEAM), site_pos(world, FRAME)
    away = norm(sub(beam, tool_pos(world)))
    if assembled(world):
        return 0.8 + 0.2 * clip(away / CLEAR_OF_BEAM_M, 0.0, 1.0)
    if grasped(world):
        beside = planar_norm(sub(beam, frame))
        straight = closeness(beam_turn(world), ALIGNED_RAD)
        low = closeness(beam[2] - frame[2], 0.05)
        return 0.4 + 0.1 * closeness(beside, 0.15) + 0.1 * closeness(beside, 0.01) * straight * (1.0 + low)
    return 0.3 * closeness(away, 0.2)


@kernel
def grasped(world):
    """Whether both pads touch the beam."""
    return touching(world, GRIP_LEFT) and touching(world, GRIP_RIGHT)


@kernel
def assembled(world):
    """Whether the beam lies in both hooks, its stripe up and an end beyond each."""
    along = rotate_back(site_mat(world, FRAME), sub(site_pos(world, BEAM), site_pos(world, FRAME)))[0]
    stripe_up = site_mat(world, BEAM)[8] >= UPRIGHT_COS
    return stripe_up and in_hook(world, -HOOK_M) and in_hook(world, HOOK_M) and abs(along) <= ALONG_M


@kernel
def in_hook(world, where):
    """Whether the beam lies in the hook that is ``where`` m along the frame from its middle."""
    beside, over = off_hook(world, where)
    return abs(beside) <= BESIDE_M and abs(over) <= OVER_FLOOR_M


@kernel
def off_hook(world, where):
    """How far the beam's axis is beside the middle of that hook and above where it is to lie, m; 1 m if across."""
    mat = site_mat(world, FRAME)
    middle = rotate_back(mat, sub(site_pos(world, BEAM), site_pos(world, FRAME)))
    axis = rotate_back(mat, column(site_mat(world, BEAM), 0))
    if abs(axis[0]) < 0.5:
        return 1.0, 1.0
    along = (where - middle[0]) / axis[0]  # from its middle to where it crosses the middle of the hook
    return middle[1] + along * axis[1], middle[2] + along * axis[2]


@kernel
def beside_hooks(world):
    """The larger of the beam's distances sideways from the middles of the two hooks, m."""
    return max(abs(off_hook(world, -HOOK_M)[0]), abs(off_hook(world, HOOK_M)[0]))


@kernel
def over_hooks(world):
    """The larger of the beam's heights in the two hooks above where it is to lie, m."""
    return max(off_hook(world, -HOOK_M)[1], off_hook(world, HOOK_M)[1])


@kernel
def doubled_heading(world, k):
    """Cosine and sine of twice the yaw of the x axis of site ``k``: the same for both directions along a beam."""
    mat = site_mat(world, k)
    length = math.sqrt(mat[0] * mat[0] + mat[3] * mat[3]) + 1e-9
    c, s = mat[0] / length, mat[3] / length
    return c * c - s * s, 2.0 * c * s


@kernel
def beam_yaw(world):
    """Yaw of the beam, rad, within ±90°: which end is which does not matter."""
    c, s = doubled_heading(world, BEAM)
    return 0.5 * math.atan2(s, c)


@kernel
def beam_turn(world):
    """Angle about the vertical by which the beam is to be turned to lie along the frame, rad, within ±90°."""
    c, s = doubled_heading(world, BEAM)
    to_c, to_s = doubled_heading(world, FRAME)
    return 0.5 * math.atan2(to_s * c - to_c * s, to_c * c + to_s * s)


def _side_on(rng: np.random.Generator, way: np.ndarray) -> float:
    """A yaw, rad, within 50° of square to ``way`` (2,), so that neither beam nor frame points at the other."""
    return float(np.arctan2(way[0], -way[1]) + rng.uniform(-0.87, 0.87))


TASK = AssembleFrame(TaskKernels(observe=observe, solved=solved, progress=progress, reward=reward, lost=lost))
