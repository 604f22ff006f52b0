"""Inspect by contact: press a probe onto a tilted plate with a given force, square to it, and keep it still."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from aerial_il.control.dynamics import put, vec
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import clip, closeness, column, dot, norm, scale, sub
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.feasibility import infeasible_pressing
from aerial_il.suite.physics.contact_sensors import CONTACT_ALONE, GRIPPER, ROBOT, add_force_sensor
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import (
    Names,
    force,
    force_sample,
    gripper_opening,
    put_rot6d,
    raw_force_sample,
    site_mat,
    site_pos,
    task_state,
    tip_pos,
    tool_mat,
    untouched,
)
from aerial_il.suite.props.place import place
from aerial_il.suite.props.plate import SPOT_RADIUS_M, TRAVEL_M, add_plate
from aerial_il.suite.tasks.fields import felt, seen, wrist_force
from aerial_il.suite.tasks.task import Task, TaskKernels, hover_start
from aerial_il.suite.timing import SUBSTEPS

FORCE_N, FORCE_TOLERANCE_N = 5.0, 2.0
SQUARE_COS = math.cos(math.radians(5.0))
TEN_DEGREES_RAD = math.radians(10.0)
SLIP_M = 0.02
CLOSED_SHARE = 0.2  # of its stroke
TOUCH_N = 0.5  # normal force at which contact begins and ends
PLATE_LOW, PLATE_HIGH = np.array([-0.25, -0.35, 0.45]), np.array([0.25, 0.35, 0.65])
TILT_RANGE_RAD = (0.15, 0.60)
YAW_RANGE_RAD = (-1.0, 1.0)
START_LOW, START_HIGH = np.array([-0.25, -0.3, 1.35]), np.array([0.3, 0.2, 1.5])
CONTACT, TOUCHED = 0, 3  # in the task's state: where contact began, world, m; whether there is contact
PRESSED, IN_BAND = 4, 5  # physics steps since then, and those among them whose raw force was in the band
PLATE = 0  # site
ON_PLATE, BY_TOOL = range(2)  # forces: on the plate, and what a sensor in the wrist feels


class InspectContact(Task):
    """Normal force of 5 ± 2 N on the plate's spot for 3 s, at most 5° off square, slipping at most 2 cm meanwhile.

    The force is the total force of all parts of the robot on the plate, sampled at each physics step (250 Hz) behind a
    first-order low-pass of 15 Hz, as in force sensors (``suite/physics/force_sensing.py`` gives the source); every
    sample must lie in the band. Unfiltered samples may not: ``force_in_band_raw`` is the share of the physics steps
    since contact began in which the contact solver's own force did. Links and rotors must not touch anything.

    The probe is the end of the closed gripper, open by a fifth at most. The plate is tilted by 9° to 34° towards the
    robot, and sprung like the holders of ultrasonic probes: it yields by 8 mm per newton. Its face is soft, like an
    ultrasound phantom: the probe sinks in by about 2 mm under the required force.
    """

    name = "inspect_contact"
    grade = "medium"
    instruction = "Press the closed gripper squarely onto the blue spot with five newtons and hold it still."
    wordings = (
        "Touch the blue spot squarely with the closed gripper at five newtons and keep still.",
        "Press on the spot with five newtons.",
        "用合拢的夹爪以五牛的力垂直压住蓝点，保持不动。",
        "以五牛顿的力按住蓝色的点。",
    )
    held_out = ("Hold the closed gripper squarely on the blue spot with five newtons.", "请用五牛的力按住蓝点。")
    time_limit_s = 40.0
    dwell_s = 3.0
    subtasks = ("over_spot", "square", "touching", "at_force", "still")
    names = Names(sites=("plate",))
    force_sensors = ("plate_force", "tool_force")
    asks_for_force = True
    privileged = (
        ("tool_force", CONTACT_ALONE),
        ("normal_force", "the force of the whole robot on the plate: measuring it takes a sensor behind the plate"),
        ("slip", "measured from the true position of the fingertips when contact began"),
    )

    def own_infeasibility(self, robot: Robot) -> str | None:
        return infeasible_pressing(robot, FORCE_N)

    def add_props(self, spec: mujoco.MjSpec, robot: Robot) -> None:
        add_plate(spec)
        add_force_sensor(spec, "plate_force", ROBOT, on="plate")
        add_force_sensor(spec, "tool_force", GRIPPER)

    def start(self, view: View, world: int, rng: np.random.Generator) -> None:
        hover_start(view, world, rng.uniform(START_LOW, START_HIGH), rng.uniform(-0.3, 0.3))
        pos, yaw, tilt = rng.uniform(PLATE_LOW, PLATE_HIGH), rng.uniform(*YAW_RANGE_RAD), rng.uniform(*TILT_RANGE_RAD)
        place(view, world, "plate_mount", pos, yaw=yaw, pitch=-tilt)
        normal = np.array([-np.sin(tilt) * np.cos(yaw), -np.sin(tilt) * np.sin(yaw), np.cos(tilt)])
        place(view, world, "plate_stand", pos - (TRAVEL_M + 0.02) * normal)

    def fields(self) -> tuple[Field, ...]:
        return (
            seen("plate_pos", "the mark on the plate"),
            seen("plate_rot6d", "first two columns of the plate's rotation", 6, unit="", frame="world from plate"),
            seen("tip_to_plate", "from the fingertips to the mark"),
            wrist_force("tool_force"),
            felt("normal_force", "force of the whole robot on the plate", 1, frame="along its normal", real=False),
            seen("slip", "how far the tip has slid since contact began; zero without contact", real=False),
        )


@kernel
def observe(world, found):
    plate = site_pos(world, PLATE)
    put(found, 0, plate)
    put_rot6d(found, 3, site_mat(world, PLATE))
    put(found, 9, sub(plate, tip_pos(world)))
    put(found, 12, force(world, BY_TOOL))
    found[15] = normal_force(world)
    put(found, 16, slip(world))


@kernel
def remember(world):
    state, felt = task_state(world), normal_force(world) >= TOUCH_N
    started = felt and not in_touch(world)
    if started:
        put(state, CONTACT, tip_pos(world))
    if started or not felt:
        state[PRESSED] = state[IN_BAND] = 0.0
    if felt:
        state[PRESSED] += SUBSTEPS
        for tick in range(SUBSTEPS):
            state[IN_BAND] += in_band(along_normal(world, raw_force_sample(world, tick)))
    state[TOUCHED] = 1.0 if felt else 0.0


@kernel
def solved(world):
    good = over_spot(world) and squareness(world) >= SQUARE_COS and at_force(world) and still(world)
    return good and gripper_opening(world) <= CLOSED_SHARE and untouched(world)


@kernel
def force_in_band_raw(world):
    state = task_state(world)
    return state[IN_BAND] / state[PRESSED] if state[PRESSED] > 0.0 else math.nan


@kernel
def progress(world, flags):
    flags[0], flags[1], flags[2] = over_spot(world), squareness(world) >= SQUARE_COS, in_touch(world)
    flags[3], flags[4] = at_force(world), still(world)


@kernel
def reward(world):
    near = closeness(norm(sub(site_pos(world, PLATE), tip_pos(world))), 0.15)
    square = closeness(math.acos(clip(squareness(world), -1.0, 1.0)), TEN_DEGREES_RAD)
    pressing = closeness(normal_force(world) - FORCE_N, FORCE_TOLERANCE_N) * closeness(norm(slip(world)), SLIP_M)
    return near * (0.3 + 0.2 * square + (0.5 * square * pressing if in_touch(world) else 0.0))


@kernel
def over_spot(world):
    """Whether the fingertips are over the mark."""
    return norm(tangential(world, sub(site_pos(world, PLATE), tip_pos(world)))) <= SPOT_RADIUS_M


@kernel
def at_force(world):
    """Whether the force has been the one asked for at every physics step of the last control step."""
    inside = 0
    for tick in range(SUBSTEPS):
        inside += in_band(along_normal(world, force_sample(world, tick)))
    return inside == SUBSTEPS


@kernel
def in_band(newtons):
    """Whether a normal force, N, is the one asked for."""
    return abs(newtons - FORCE_N) <= FORCE_TOLERANCE_N


@kernel
def still(world):
    """Whether the tool is in contact and has not slid."""
    return in_touch(world) and norm(slip(world)) <= SLIP_M


@kernel
def normal(world):
    """Unit normal out of the plate, world frame."""
    return column(site_mat(world, PLATE), 2)


@kernel
def normal_force(world):
    """Force with which the robot presses the plate, N; below zero it would pull."""
    return along_normal(world, force(world, ON_PLATE))


@kernel
def along_normal(world, vector):
    """Component of a force on the plate, world frame, N, that presses it along its normal, N."""
    return -dot(normal(world), vector)


@kernel
def squareness(world):
    """Cosine of the angle between the tool's axis and the plate's normal."""
    return -dot(normal(world), column(tool_mat(world), 0))


@kernel
def tangential(world, vector):
    """Part of a vector that lies in the plate's plane."""
    out = normal(world)
    return sub(vector, scale(dot(out, vector), out))


@kernel
def in_touch(world):
    """Whether the tool is in contact with the plate."""
    return task_state(world)[TOUCHED] > 0.0


@kernel
def slip(world):
    """Distance the fingertips have slid over the plate since contact began, world frame, m; zero without contact."""
    if not in_touch(world):
        return (0.0, 0.0, 0.0)
    return tangential(world, sub(tip_pos(world), vec(task_state(world), CONTACT)))


TASK = InspectContact(
    TaskKernels(
        observe=observe,
        solved=solved,
        progress=progress,
        reward=reward,
        remember=remember,
        force_in_band_raw=force_in_band_raw,
    )
)
