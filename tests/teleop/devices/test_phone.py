"""A phone in the hand: its poses by WebXR and by its sensor, its clutch, and a vehicle that follows without a jump."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerial_il import robots
from aerial_il.core.rotations import mat_from_axis_angle
from aerial_il.teleop.devices.phone import CLUTCH, Phone, Pose, pose_of
from aerial_il.teleop.input.frame import AXES, PHONE_AXES, DeviceFrame, bits_of
from aerial_il.teleop.piloting.follow import Follower
from aerial_il.teleop.piloting.pilot import ManualPilot
from aerial_il.teleop.web.messages import MessageError, read_message
from tests.teleop.hands import first, shipped, world

X, Y, Z = np.eye(3)
ANGLES = st.floats(-180, 180)


def xr(position: tuple[float, float, float], orientation: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0)) -> Pose:
    return pose_of({"position": list(position), "orientation": list(orientation)})


def moved(phone: Phone, pose: Pose | None, **settings: bool) -> dict[str, float]:
    return phone.move(pose, clutched=True, **{"closed_now": False, **settings})[0]


def test_a_phone_points_where_its_back_or_its_top_does() -> None:
    upright = xr((0.0, 0.0, 0.0))
    assert upright.heading == pytest.approx(math.pi / 2), "WebXR looks along -z, which is y of a frame with z up"
    flat = pose_of({"angles": [0, 0, 0]})
    assert flat.heading == pytest.approx(math.pi / 2), "its top edge points north"
    assert pose_of({"angles": [90, 0, 0]}).heading == pytest.approx(math.pi), "turned to the left by a quarter"
    assert pose_of({"angles": [0, 45, 0]}).heading == pytest.approx(math.pi / 2), "held as one reads"


@pytest.mark.parametrize(
    ("position", "axis", "value"),
    [((0, 0, -0.1), "phone_x", 0.1), ((-0.1, 0, 0), "phone_y", 0.1), ((0, 0.1, 0), "phone_z", 0.1)],
)
def test_ahead_left_and_up_of_webxr(position: tuple, axis: str, value: float) -> None:
    phone = Phone()
    moved(phone, xr((0, 0, 0)), closed_now=True)
    axes = moved(phone, xr(position))
    assert axes[axis] == pytest.approx(value)
    assert sum(map(abs, axes.values())) == pytest.approx(value)


def test_turns_of_the_sensor_are_about_ahead_left_and_up() -> None:
    phone = Phone()
    moved(phone, pose_of({"angles": [30, 0, 0]}), closed_now=True)
    axes = moved(phone, pose_of({"angles": [60, 0, 0]}))
    assert axes["phone_yaw"] == pytest.approx(1 / 6), "30 degrees to the left"
    moved(phone, pose_of({"angles": [30, 0, 0]}), closed_now=True)
    axes = moved(phone, pose_of({"angles": [30, 20, 0]}))
    assert axes["phone_pitch"] == pytest.approx(-1 / 9), "its top up is the point up"
    assert abs(axes["phone_yaw"]) + abs(axes["phone_roll"]) < 1e-9


@given(ANGLES, ANGLES, ANGLES)
def test_the_angles_of_the_sensor_are_intrinsic_z_x_y(alpha: float, beta: float, gamma: float) -> None:
    turns = zip((Z, X, Y), (alpha, beta, gamma), strict=True)
    a, b, c = (np.reshape(mat_from_axis_angle(tuple(axis), math.radians(angle)), (3, 3)) for axis, angle in turns)
    np.testing.assert_allclose(np.reshape(pose_of({"angles": [alpha, beta, gamma]}).rot, (3, 3)), a @ b @ c, atol=1e-9)


def test_closing_the_clutch_elsewhere_centres_it_anew() -> None:
    phone = Phone()
    moved(phone, xr((0, 0, 0)), closed_now=True)
    assert moved(phone, xr((0, 0, -0.2)))["phone_x"] == pytest.approx(0.2)
    assert not any(phone.move(xr((0, 0, 0.1)), clutched=False, closed_now=False)[0].values())
    axes, anew = phone.move(xr((3, 1, 0.1)), clutched=True, closed_now=True)
    assert anew
    assert not any(axes.values()), "where it was put down moves nothing"


def test_a_phone_that_has_lost_itself_is_centred_anew() -> None:
    phone = Phone()
    moved(phone, xr((0, 0, 0)), closed_now=True)
    moved(phone, xr((0, 0, -0.2)))
    axes, anew = phone.move(xr((0, 5, 0)), clutched=True, closed_now=False)
    assert anew
    assert not any(axes.values())
    before = moved(phone, xr((0, 5.1, 0)))
    assert moved(phone, None) == before


@pytest.mark.parametrize(
    "pose",
    [
        {}, [], 3, {"position": [0, 0, 0]}, {"position": [0, 0], "orientation": [0, 0, 0, 1]},
        {"position": [0, 0, 0], "orientation": [0, 0, 0, 0]}, {"angles": [0, 0]}, {"angles": [0, 0, "0"]},
        {"angles": [0, 0, 1e9]}, {"position": [0, 0, 1e99], "orientation": [0, 0, 0, 1]}, {"angles": [True, 0, 0]},
    ],
)  # fmt: skip
def test_poses_of_the_wrong_shape_are_not_believed(pose: object) -> None:
    with pytest.raises(MessageError):
        read_message(json.dumps({"type": "input", "pose": pose}))


def frame(seq: int, axes: dict[str, float], *, held: bool = True, pressed: bool = False) -> DeviceFrame:
    controls = shipped("phone").controls
    bits = bits_of([CLUTCH], controls)
    return DeviceFrame(seq, tuple(axes.get(name, 0.0) for name in AXES), bits * held, bits * pressed)


def test_closing_the_clutch_moves_nothing() -> None:
    """Measured on a vehicle: the command of the tick in which it is closed, and the action's difference, are zero."""
    env = world()
    pilot = ManualPilot(env.spec, robots.get(env.spec.robot).vehicle, shipped("phone"))
    obs = first(env.reset(5002))
    pilot.engage(obs)
    start, jumps = pilot.act(frame(1, {}, held=False), obs), []
    for seq, place in enumerate((0.9, -0.7, 0.3), start=2):
        action = pilot.act(frame(seq, dict.fromkeys(PHONE_AXES, place), pressed=True), obs)
        jumps.append(float(np.abs(action - start).max()))
        assert pilot.command.linear == (0.0, 0.0, 0.0)
        assert pilot.command.yaw_rate == 0.0
    assert max(jumps) < 1e-12
    pilot.act(frame(9, dict.fromkeys(PHONE_AXES, 0.5)), obs)
    assert pilot.command.linear[0] > 0.1, "and then it does move: the test can fail"
    env.close()


def test_the_tool_goes_as_far_as_the_hand() -> None:
    env = world()
    pilot = ManualPilot(env.spec, robots.get(env.spec.robot).vehicle, shipped("phone"))
    obs = first(env.reset(5002))
    pilot.engage(obs)
    before = obs["ee_pos"].copy()
    for tick in range(150):
        axes = {"phone_z": min(0.1, 0.002 * tick), "phone_x": -min(0.1, 0.002 * tick)}
        obs = first(env.step(pilot.act(frame(tick + 1, axes, pressed=tick == 0), obs)[None]).obs)
    went = obs["ee_pos"] - before
    assert went[2] == pytest.approx(0.1, abs=0.02)
    assert np.linalg.norm(went) == pytest.approx(math.hypot(0.1, 0.1), abs=0.03)
    env.close()


@given(st.lists(st.tuples(*[st.floats(-1, 1)] * 6), min_size=1, max_size=30), st.floats(-3, 3))
def test_a_hand_that_trembles_is_followed_within_the_caps(poses: list, heading: float) -> None:
    follower = Follower()
    for i, pose in enumerate(poses):
        command = follower.step(pose, heading, 0.02, closed_now=i == 0)
        assert math.hypot(*command.linear) <= 0.4 + 1e-9
        assert math.hypot(command.yaw_rate, *command.turn) <= 0.8 + 1e-9


def test_directions_stay_while_the_vehicle_turns() -> None:
    follower = Follower()
    follower.step((0.0,) * 6, 0.0, 0.02, closed_now=True)
    command = follower.step((0.1, 0.0, 0.0, 0.0, 0.0, 0.0), math.pi / 2, 0.02, closed_now=False)
    assert command.linear[1] == pytest.approx(-0.4), "ahead of the hand is right of a vehicle that has turned left"
    assert abs(command.linear[0]) < 1e-9
