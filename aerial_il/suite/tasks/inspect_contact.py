"""Inspect by contact: press a probe onto a tilted plate with a given force, square to it, and keep it still."""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.core.arrays import closeness, length
from aerial_il.core.specs import Field
from aerial_il.robots.robot import Robot
from aerial_il.suite.abilities import obstacle_to_pressing
from aerial_il.suite.contact_sensors import GRIPPER, ROBOT, add_force_sensor
from aerial_il.suite.props.place import place
from aerial_il.suite.props.plate import SPOT_RADIUS_M, TRAVEL_M, add_plate
from aerial_il.suite.tasks.task import Task, hover_start
from aerial_il.suite.view import View

FORCE_N, FORCE_TOLERANCE_N = 5.0, 2.0
SQUARE_COS = np.cos(np.deg2rad(5.0))
SLIP_M = 0.02
CLOSED_SHARE = 0.2  # of its stroke
TOUCH_N = 0.5  # normal force at which contact begins and ends
PLATE_LOW, PLATE_HIGH = np.array([-0.25, -0.35, 0.45]), np.array([0.25, 0.35, 0.65])
TILT_RANGE_RAD = (0.15, 0.60)
YAW_RANGE_RAD = (-1.0, 1.0)
START_LOW, START_HIGH = np.array([-0.25, -0.3, 1.35]), np.array([0.3, 0.2, 1.5])
TOOL = 1  # which force is the tool's alone
CONTACT, TOUCHED = slice(0, 3), 3  # in the task's memory: where contact began, world, m; whether there is contact
PRESSED, IN_BAND = 4, 5  # physics steps since then, and those among them whose raw force was in the band


class InspectContact(Task):
    """Normal force of 5 ± 2 N on the plate's spot for 3 s, at most 5° off square, slipping at most 2 cm meanwhile.

    The force is what all parts of the robot together exert on the plate, taken at each physics step (250 Hz) behind a
    first-order low-pass of 15 Hz, as force sensors have (``suite/force_sensing.py`` gives the source); every one of
    these values must lie in the band. Without the filter some do not: ``force_in_band_raw`` is the share of the physics
    steps since contact began in which the contact solver's own force did. Links and rotors must not touch anything.

    The probe is the end of the closed gripper, open by a fifth at most. The plate is tilted by 9° to 34° towards the
    robot, and sprung like the holders of ultrasonic probes: it gives way by 8 mm per newton.
    """

    name = "inspect_contact"
    grade = "medium"
    instruction = "Press the closed gripper squarely onto the blue spot with five newtons and hold it still."
    time_limit_s = 40.0
    dwell_s = 3.0
    subtasks = ("over_spot", "square", "touching", "at_force", "still")
    force_sensors = ("plate_force", "tool_force")
    asks_for_force = True

    def obstacle_to(self, robot: Robot) -> str | None:
        return obstacle_to_pressing(robot, FORCE_N)

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
        xyz = ("x", "y", "z")
        return (
            Field("plate_pos", (3,), "task", unit="m", labels=xyz),
            Field("plate_rot6d", (6,), "task"),
            Field("tip_to_plate", (3,), "task", unit="m", labels=xyz),
            Field("tool_force", (3,), "task", unit="N", labels=xyz),
            Field("normal_force", (1,), "task", unit="N"),
            Field("slip", (3,), "task", unit="m", labels=xyz),
        )

    def observe(self, view: View) -> dict[str, np.ndarray]:
        plate = view.site_pos("plate")
        return {
            "plate_pos": plate.copy(),
            "plate_rot6d": view.site_rot6d("plate"),
            "tip_to_plate": plate - view.tip_pos,
            "tool_force": view.force(TOOL).copy(),
            "normal_force": normal_force(view)[:, None],
            "slip": slip(view),
        }

    def remember(self, view: View, mask: np.ndarray) -> None:
        felt = normal_force(view) >= TOUCH_N
        begun = mask & felt & ~touching(view)
        raw = in_band(along_normal(view, view.raw_force_samples))
        view.memory[begun, CONTACT] = view.tip_pos[begun]
        view.memory[mask & (begun | ~felt), PRESSED : IN_BAND + 1] = 0.0
        view.memory[mask & felt, PRESSED] += raw.shape[1]
        view.memory[mask & felt, IN_BAND] += raw.sum(axis=1)[mask & felt]
        view.memory[mask, TOUCHED] = felt[mask]

    def solved(self, view: View) -> np.ndarray:
        closed = view.gripper[:, 0] <= CLOSED_SHARE
        return self.progress(view).all(axis=1) & closed & (view.unwanted_contacts == 0)

    def progress(self, view: View) -> np.ndarray:
        over = length(tangential(view, view.site_pos("plate") - view.tip_pos)) <= SPOT_RADIUS_M
        at_force = in_band(along_normal(view, view.force_samples)).all(axis=1)
        still = touching(view) & (length(slip(view)) <= SLIP_M)
        return np.stack([over, squareness(view) >= SQUARE_COS, touching(view), at_force, still], axis=1)

    def force_in_band_raw(self, view: View) -> np.ndarray:
        pressed, inside = view.memory[:, PRESSED], view.memory[:, IN_BAND]
        return np.where(pressed > 0.0, inside / np.maximum(pressed, 1.0), np.nan)

    def reward(self, view: View) -> np.ndarray:
        near = closeness(length(view.site_pos("plate") - view.tip_pos), 0.15)
        square = closeness(np.arccos(np.clip(squareness(view), -1.0, 1.0)), np.deg2rad(10.0))
        force, slipped = normal_force(view), length(slip(view))
        pressing = closeness(force - FORCE_N, FORCE_TOLERANCE_N) * closeness(slipped, SLIP_M)
        return near * (0.3 + 0.2 * square + np.where(touching(view), 0.5 * square * pressing, 0.0))


def normal(view: View) -> np.ndarray:
    """(n, 3) unit normal out of the plate, world."""
    return view.site_mat("plate")[:, 2::3]


def normal_force(view: View) -> np.ndarray:
    """(n,) force with which the robot presses the plate, N; below zero it would pull."""
    return along_normal(view, view.force()[:, None])[:, 0]


def along_normal(view: View, forces: np.ndarray) -> np.ndarray:
    """(n, T) how hard forces (n, T, 3) on the plate, world, N, press it along its normal."""
    out = normal(view)[:, None]
    return -(out[..., 0] * forces[..., 0] + out[..., 1] * forces[..., 1] + out[..., 2] * forces[..., 2])


def in_band(force: np.ndarray) -> np.ndarray:
    """Whether normal forces (...), N, are those asked for."""
    return np.abs(force - FORCE_N) <= FORCE_TOLERANCE_N


def squareness(view: View) -> np.ndarray:
    """(n,) cosine of the angle between the tool's axis and the plate's normal."""
    out, axis = normal(view), view.tool_mat[:, 0::3]
    return -(out[:, 0] * axis[:, 0] + out[:, 1] * axis[:, 1] + out[:, 2] * axis[:, 2])


def tangential(view: View, vectors: np.ndarray) -> np.ndarray:
    """(n, 3) part of vectors (n, 3) that lies in the plate's plane."""
    out = normal(view)
    across = out[:, 0] * vectors[:, 0] + out[:, 1] * vectors[:, 1] + out[:, 2] * vectors[:, 2]
    return vectors - across[:, None] * out


def touching(view: View) -> np.ndarray:
    """(n,) bool: the tool is in contact with the plate."""
    return view.memory[:, TOUCHED] > 0.0


def slip(view: View) -> np.ndarray:
    """(n, 3) how far the fingertips have slid over the plate since contact began, world, m; zero without contact."""
    moved = tangential(view, view.tip_pos - view.memory[:, CONTACT])
    return np.where(touching(view)[:, None], moved, 0.0)


TASK = InspectContact()
