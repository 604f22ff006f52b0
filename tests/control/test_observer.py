"""The disturbance observer meets what is no wind: an unknown payload, tables and walls."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from aerial_il import robots
from aerial_il.control.vehicle import GRAVITY
from aerial_il.robots.parts.collision import WORLD
from tests.control.in_the_air import Flight

ROBOTS = ("fa_hexa_arm4", "ua_quad_arm4")
each_robot = pytest.mark.parametrize("robot", ROBOTS)


def payload(mass: float):
    """A function that welds a ball of ``mass`` kg to the hand, between the fingers."""

    def furnish(spec: mujoco.MjSpec) -> None:
        hand = spec.site("tool").parent
        ball = hand.add_body(name="payload", pos=spec.site("tool").pos)
        ball.add_geom(
            name="payload", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.02, 0, 0], mass=mass, contype=0, conaffinity=0
        )

    return furnish


def plate(pos: np.ndarray, pitch: float):
    """A function that puts a fixed plate there, m, square to a tool that points down by ``pitch`` rad."""

    def furnish(spec: mujoco.MjSpec) -> None:
        spec.option.cone, spec.option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, 10.0
        quat = [np.cos(0.5 * pitch), 0.0, np.sin(0.5 * pitch), 0.0]
        box = mujoco.mjtGeom.mjGEOM_BOX
        spec.worldbody.add_geom(name="plate", type=box, pos=pos, quat=quat, size=[0.02, 0.15, 0.15], **WORLD)

    return furnish


def contact_force(flight: Flight) -> np.ndarray:
    """(3,) what the plate exerts on the robot, world, N."""
    total, plate_id = np.zeros(3), flight.model.geom("plate").id
    for k, contact in enumerate(flight.data.contact):
        if plate_id in contact.geom:
            force = np.zeros(6)
            mujoco.mj_contactForce(flight.model, flight.data, k, force)
            total += (1.0 if contact.geom[0] == plate_id else -1.0) * contact.frame.reshape(3, 3).T @ force[:3]
    return total


@each_robot
@pytest.mark.parametrize("gripper", [0.0, 1.0], ids=["closed", "open"])
def test_a_payload_of_a_tenth_of_the_weight_is_carried(robot: str, gripper: float) -> None:
    vehicle = robots.get(robot).vehicle
    mass = 0.1 * vehicle.mass
    flight = Flight(robot, furnish=payload(mass))
    action = flight.pose()
    action[-1] = gripper
    flight.fly(action, 6.0)
    assert np.linalg.norm(flight.tool - action[:3]) < 0.02
    assert flight.tilt < np.deg2rad(5.0)
    assert np.linalg.norm(flight.data.qvel[:6]) < 0.02
    np.testing.assert_allclose(
        flight.controller.disturbance[:3], [0.0, 0.0, -mass * GRAVITY], atol=0.05 * mass * GRAVITY
    )
    flight.fly(action + np.array([0.3, 0.0, 0.1, *np.zeros(7)]), 5.0)
    assert np.linalg.norm(flight.tool - action[:3] - [0.3, 0.0, 0.1]) < 0.025


@each_robot
@pytest.mark.parametrize("pitch_deg", [90.0, 45.0], ids=["table", "slanted wall"])
def test_pressing_on_a_table_or_a_wall_stays_calm_and_bounded(robot: str, pitch_deg: float) -> None:
    """Sent 3 cm into it, the vehicle leans on it, holds still, and comes away as it came."""
    pitch, away = np.deg2rad(pitch_deg), robots.get(robot).gripper.finger_length + 0.05
    axis = np.array([np.cos(pitch), 0.0, -np.sin(pitch)])
    before = Flight(robot).tool + np.array([0.2 * np.cos(pitch), 0.0, 0.0])
    flight = Flight(robot, furnish=plate(before + (away + 0.02) * axis, pitch))
    free = np.array([*before, *axis, 0.0, 1.0, 0.0, 0.0])
    flight.fly(free, 4.0)
    pressed = free.copy()
    pressed[:3] += (away + 0.03) * axis
    flight.fly(pressed, 5.0)
    pushes, tilts = [], []
    for _ in range(100):  # means over 20 ms, for rigid contacts rattle from one physics step to the next
        ticks = []
        for _ in range(5):
            flight.fly(pressed, 0.004)
            ticks.append(-contact_force(flight) @ axis)
        pushes.append(np.mean(ticks))
        tilts.append(flight.tilt)
    weight = flight.vehicle.mass * GRAVITY
    assert 0.03 * weight < np.mean(pushes) < 0.7 * weight
    assert np.std(pushes) < 0.2 * weight
    assert max(tilts) < np.deg2rad(25.0)
    flight.fly(free, 5.0)
    assert np.linalg.norm(flight.tool - before) < 0.005
    assert np.linalg.norm(flight.controller.disturbance[:3]) < 0.02 * weight
