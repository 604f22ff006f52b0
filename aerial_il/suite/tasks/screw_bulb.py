"""Screw in a bulb: grip a lamp by its flats from above and turn it twice round, down its thread."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from aerial_il.control.dynamics import put
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import clip, closeness, norm, sub
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.feasibility import infeasible_twisting, infeasible_upright_hold
from aerial_il.suite.physics.contact_sensors import CONTACT_ALONE, GRIPPER, add_contact_sensor, add_force_sensor
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import (
    Names,
    force,
    joint_pos,
    joint_vel,
    site_mat,
    site_pos,
    tool_pos,
    touching,
    untouched,
)
from aerial_il.suite.props.bulb import FLATS_HALF_M, LEAD_M, SOCKET_DEPTH_M, SOCKET_TOP_M, STOP_RAD, TURNS, add_bulb
from aerial_il.suite.props.place import place
from aerial_il.suite.tasks.fields import direction, seen, wrist_force
from aerial_il.suite.tasks.task import Task, TaskKernels, hover_start

SCREWED_RAD = 2.0 * math.pi * TURNS
SCREWED_M, THREAD_PLAY_M = TURNS * LEAD_M, 0.0004
STOP_GIVE_RAD = 0.1
TORQUE_NM = 0.09  # at the end, with damping
START_ANGLE_RAD = (0.0, 0.6)
ROOM_FOR_ERRORS_M = 0.03  # between flats and open fingers, together
SOCKET_LOW, SOCKET_HIGH = np.array([-0.20, -0.25, 0.40]), np.array([0.20, 0.25, 0.55])
START_LOW, START_HIGH = np.array([-0.3, -0.3, 1.15]), np.array([0.3, 0.3, 1.35])
BULB = 0  # site
TURN, TRAVEL = range(2)  # joints
GRIP_LEFT, GRIP_RIGHT = range(2)  # contacts


class ScrewBulb(Task):
    """Lamp turned by two full turns or more and 7.2 mm deep in its thread, to 0.4 mm, for 0.5 s, held or not.

    The thread begins at zero and has a lead of 3.6 mm; the lamp starts up to 0.6 rad in. Its dry friction is 0.02 N m,
    and after the first turn the lamp rubs on the sprung contact in the socket, which makes that 0.09 N m at the end. It
    counts up to the stop, 0.6 rad beyond two turns, which yields by up to 0.1 rad. Screwing it out again undoes it.
    Links and rotors must not touch anything.
    """

    name = "screw_bulb"
    grade = "hard"
    instruction = "Grip the bulb by its flats and screw it into the socket, two turns clockwise."
    wordings = (
        "Screw the bulb into its socket by two turns.",
        "Turn the bulb clockwise until it is all the way in.",
        "把灯泡拧进灯座，转两圈。",
        "顺时针旋转灯泡，直到拧紧。",
    )
    held_out = (
        "Turn the bulb by two turns into the socket.",
        "请把灯泡拧到底。",
    )
    time_limit_s = 60.0
    dwell_s = 0.5
    subtasks = ("at_bulb", "gripped", "half_turn", "one_turn", "two_turns")
    names = Names(sites=("bulb",), joints=("bulb_turn", "bulb_travel"), contacts=("grip_left", "grip_right"))
    force_sensors = ("wrist_force",)
    privileged = (("wrist_force", CONTACT_ALONE),)

    def own_infeasibility(self, robot: Robot) -> str | None:
        opening, needed = 2.0 * robot.gripper.stroke, 2.0 * FLATS_HALF_M + ROOM_FOR_ERRORS_M
        if opening < needed:
            return f"its gripper opens {100 * opening:.1f} cm, the lamp needs {100 * needed:.1f} cm"
        return infeasible_upright_hold(robot) or infeasible_twisting(robot, TORQUE_NM)

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_bulb(spec)
        for side in ("left", "right"):
            add_contact_sensor(spec, f"grip_{side}", geoms=(f"pad_{side}", "bulb_flats"))
        add_force_sensor(spec, "wrist_force", GRIPPER)

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        pos = rng.uniform(SOCKET_LOW, SOCKET_HIGH)
        place(view, world, "socket", pos, yaw=rng.uniform(-np.pi, np.pi))
        place(view, world, "socket_stand", pos + np.array([0.0, 0.0, SOCKET_TOP_M - SOCKET_DEPTH_M]))
        (turn, _), (travel, _) = view.joint("bulb_turn"), view.joint("bulb_travel")
        turn[world] = rng.uniform(*START_ANGLE_RAD)
        travel[world] = LEAD_M / (2.0 * np.pi) * turn[world]

    def fields(self) -> tuple[Field, ...]:
        return (
            seen("bulb_pos", "middle of the lamp's flats"),
            direction("bulb_heading", "of four times its yaw, the same for all four flats", labels=("cos4", "sin4")),
            seen("turned", "how far it has been turned since its thread began", 1, unit="rad", frame="about its axis"),
            seen("turn_rate", "its rate", 1, unit="rad/s", frame="about its axis"),
            seen("depth", "how deep it is in its thread", 1, frame="along its axis"),
            seen("tool_to_bulb", "from the tool to the middle of the flats"),
            wrist_force(),
        )


@kernel
def observe(world, found):
    bulb = site_pos(world, BULB)
    put(found, 0, bulb)
    found[3], found[4] = bulb_heading(world)
    found[5], found[6] = joint_pos(world, TURN), joint_vel(world, TURN)
    found[7] = joint_pos(world, TRAVEL)
    put(found, 8, sub(bulb, tool_pos(world)))
    put(found, 11, force(world, 0))


@kernel
def solved(world):
    return screwed_in(world) and untouched(world)


@kernel
def progress(world, flags):
    turned = joint_pos(world, TURN)
    flags[0], flags[1] = norm(sub(site_pos(world, BULB), tool_pos(world))) <= 0.03, gripped(world)
    flags[2], flags[3], flags[4] = turned >= 0.25 * SCREWED_RAD, turned >= 0.5 * SCREWED_RAD, screwed_in(world)


@kernel
def reward(world):
    near = closeness(norm(sub(site_pos(world, BULB), tool_pos(world))), 0.15)
    share = clip(joint_pos(world, TURN) / SCREWED_RAD, 0.0, 1.0)
    return 0.2 * near + (0.1 if gripped(world) else 0.0) + 0.7 * share


@kernel
def screwed_in(world):
    """Whether the lamp has been turned down its thread, and neither through its stop nor out of the thread."""
    turned, travel = joint_pos(world, TURN), joint_pos(world, TRAVEL)
    in_thread = abs(travel - LEAD_M / (2.0 * math.pi) * turned) <= THREAD_PLAY_M
    return SCREWED_RAD <= turned <= STOP_RAD + STOP_GIVE_RAD and travel >= SCREWED_M - THREAD_PLAY_M and in_thread


@kernel
def gripped(world):
    """Whether both pads touch the flats."""
    return touching(world, GRIP_LEFT) and touching(world, GRIP_RIGHT)


@kernel
def bulb_heading(world):
    """Cosine and sine of four times the lamp's yaw: the same for every flat that could be gripped."""
    mat = site_mat(world, BULB)
    length = math.sqrt(mat[0] * mat[0] + mat[3] * mat[3]) + 1e-9
    c, s = mat[0] / length, mat[3] / length
    c2, s2 = c * c - s * s, 2.0 * c * s
    return c2 * c2 - s2 * s2, 2.0 * c2 * s2


@kernel
def bulb_yaw(world):
    """The lamp's yaw, rad, that is nearest to zero among those of its four flats."""
    c, s = bulb_heading(world)
    return 0.25 * math.atan2(s, c)


TASK = ScrewBulb(TaskKernels(observe=observe, solved=solved, progress=progress, reward=reward))
