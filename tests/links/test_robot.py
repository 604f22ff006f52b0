"""A simulated robot takes orders and set points as a real one would, and refuses what it cannot do."""

import numpy as np
import pytest

from aerial_il import load_batch
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.latency import Latency
from aerial_il.links.link import Mode, Order, RefusedError
from aerial_il.links.robot import SimulatedRobot
from aerial_il.suite.late import late

ARM = "ua_quad_arm4"


@pytest.fixture
def robot() -> SimulatedRobot:
    return SimulatedRobot(ARM, "pick_place")


def until(robot: SimulatedRobot, mode: Mode, *, most: int = 600) -> int:
    for ticks in range(most):
        if robot.mode is mode:
            return ticks
        robot.tick()
    raise AssertionError(f"it is {robot.mode}")


def flying(robot: SimulatedRobot) -> SimulatedRobot:
    robot.order(Order.ARM)
    robot.order(Order.TAKE_OFF)
    until(robot, Mode.HOLDING)
    return robot


def test_it_stands_until_it_takes_off(robot: SimulatedRobot) -> None:
    before = robot.reading()
    robot.order(Order.ARM)
    for _ in range(50):
        robot.command("ee_pose", np.array([1.0, 1.0, 1.0, *before.obs["ee_rot6d"], 1.0]))
        robot.tick()
    after = robot.reading()
    assert after.stamp_s > before.stamp_s
    assert after.mode is Mode.STANDING
    for name, value in before.obs.items():
        np.testing.assert_array_equal(after.obs[name], value)


def test_it_lands_in_its_cradle(robot: SimulatedRobot) -> None:
    start = robot.reading().obs
    flying(robot)
    risen = robot.reading().obs["base_pos"] - start["base_pos"]
    np.testing.assert_allclose(risen, [0.0, 0.0, 0.3], atol=0.06)
    away = np.array([*(start["base_pos"] + [0.4, 0.3, 0.3]), 0.5, *(start["joint_pos"] + 0.2), 1.0])
    for _ in range(150):
        robot.command("base_joint", away)
        robot.tick()
    np.testing.assert_allclose(robot.reading().obs["base_pos"], away[:3], atol=0.03)
    np.testing.assert_allclose(robot.reading().obs["joint_pos"], away[4:8], atol=0.03)
    robot.order(Order.LAND)
    until(robot, Mode.STANDING)
    assert not robot.armed
    np.testing.assert_allclose(robot.reading().obs["base_pos"], start["base_pos"], atol=0.03)


@pytest.mark.parametrize("level", ["ee_pose", "base_joint", "velocity"])
def test_it_changes_levels_without_a_jerk(robot: SimulatedRobot, level: str) -> None:
    flying(robot)
    for _ in range(100):
        robot.tick()
    stay = robot.reading().obs
    hold = {
        "ee_pose": np.array([*stay["ee_pos"], *stay["ee_rot6d"], 1.0]),
        "base_joint": np.array([*stay["base_pos"], 0.0, *stay["joint_pos"], 1.0]),
        "velocity": np.array([0.0] * 4 + [0.0] * 4 + [1.0]),
    }
    hold["base_joint"][3] = np.arctan2(stay["base_rot6d"][1], stay["base_rot6d"][0])
    for first in ("base_joint", level):
        for _ in range(40):
            robot.command(first, hold[first])
            robot.tick()
            assert np.linalg.norm(robot.reading().obs["ee_pos"] - stay["ee_pos"]) < 0.05


def test_it_hovers_when_it_hears_nothing(robot: SimulatedRobot) -> None:
    flying(robot)
    for _ in range(30):
        robot.command("velocity", np.array([0.6, 0.0, 0.0, 0.0, *[0.0] * 4, 0.0]))
        robot.tick()
    assert robot.mode is Mode.FLYING
    assert until(robot, Mode.HOLDING) * robot.spec.control_dt_s <= 0.3
    for _ in range(100):
        robot.tick()
    assert np.linalg.norm(robot.reading().obs["base_vel"]) < 0.05
    assert robot.reading().obs["gripper"][0] < 0.2, "what it held, it holds"
    robot.command("velocity", np.zeros(9))
    robot.tick()
    assert robot.mode is Mode.FLYING


def test_an_order_to_hover_outlasts_set_points(robot: SimulatedRobot) -> None:
    flying(robot)
    robot.order(Order.HOVER)
    for _ in range(40):
        robot.command("velocity", np.array([1.0, 0.0, 0.0, 0.0, *[0.0] * 4, 1.0]))
        robot.tick()
    assert robot.mode is Mode.HOLDING
    assert abs(robot.reading().obs["base_vel"][0]) < 0.1
    robot.order(Order.FOLLOW)
    robot.command("velocity", np.array([1.0, 0.0, 0.0, 0.0, *[0.0] * 4, 1.0]))
    robot.tick()
    assert robot.mode is Mode.FLYING


@pytest.mark.parametrize(
    ("order", "numbers", "word"),
    [
        (Order.TAKE_OFF, {}, "not armed"),
        (Order.LAND, {}, "it stands"),
        (Order.HOVER, {}, "it stands"),
    ],
)
def test_what_cannot_be_done_is_refused(robot: SimulatedRobot, order: Order, numbers: dict, word: str) -> None:
    with pytest.raises(RefusedError, match=word):
        robot.order(order, **numbers)


def test_a_height_beyond_its_set_points_is_refused(robot: SimulatedRobot) -> None:
    robot.order(Order.ARM)
    with pytest.raises(RefusedError, match=r"set points end 1\.\d+ m above"):
        robot.order(Order.TAKE_OFF, height_m=2.0)
    assert robot.mode is Mode.STANDING


def test_it_has_landed_when_its_skids_rest_beside_the_cradle() -> None:
    robot = SimulatedRobot("quad", "take_off", tier="gusts")
    robot.reset(2)
    flying(robot)
    aside = np.array([*(robot.reading().obs["base_pos"] + [0.3, 0.2, 0.7]), 0.0])
    for _ in range(100):
        robot.command("base_joint", aside)
        robot.tick()
    robot.order(Order.LAND)
    until(robot, Mode.STANDING)
    assert not robot.armed


def test_in_the_air_it_is_not_disarmed_nor_takes_off(robot: SimulatedRobot) -> None:
    flying(robot)
    for order in (Order.DISARM, Order.TAKE_OFF):
        with pytest.raises(RefusedError, match="in the air"):
            robot.order(order)
    assert robot.armed


@pytest.mark.parametrize(
    ("level", "action", "word"),
    [
        ("velocity", np.zeros(8), "takes 9 numbers"),
        ("velocity", np.full(9, np.nan), "base_vel_x of the set point is not finite"),
        ("rotor", np.zeros(9), "takes no set points at 'rotor'"),
        ("ee_delta", np.zeros(7), "takes no set points at 'ee_delta'"),
    ],
)
def test_a_bad_set_point_changes_nothing(robot: SimulatedRobot, level: str, action: np.ndarray, word: str) -> None:
    flying(robot)
    before = robot.mode
    with pytest.raises(RefusedError, match=word):
        robot.command(level, action)
    robot.tick()
    assert robot.mode is before


def test_a_level_that_builds_on_the_last_set_point_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="lost or late"):
        SimulatedRobot(ARM, "reach", level="ee_delta")


@pytest.mark.parametrize("latency", [Latency(), Latency(observation_delay_ms=40, action_delay_ms=60)])
def test_released_at_its_start_it_flies_as_the_suite_does(latency: Latency) -> None:
    robot, env = SimulatedRobot(ARM, "reach", latency=latency), late(load_batch(ARM, "reach", num_envs=1), latency)
    robot.reset(7)
    robot.order(Order.ARM)
    robot.order(Order.TAKE_OFF, height_m=0.0)
    obs = env.reset(7)
    rng = np.random.default_rng(0)
    for _ in range(60):
        action = np.array([*rng.uniform(-0.5, 0.5, 2), 1.2, *obs["ee_rot6d"][0], 1.0])
        robot.command("ee_pose", action)
        robot.tick()
        obs = env.step(action[None]).obs
        for name, value in robot.reading().obs.items():
            np.testing.assert_array_equal(value, obs[name][0])


def test_who_crashes_stays_down_until_it_is_reset(robot: SimulatedRobot) -> None:
    flying(robot)
    for _ in range(400):
        robot.command("velocity", np.array([1.5, 0.0, 0.0, 0.0, *[0.0] * 4, 1.0]))
        robot.tick()
        if robot.mode is Mode.CRASHED:
            break
    assert robot.mode is Mode.CRASHED
    with pytest.raises(RefusedError, match="reset"):
        robot.order(Order.ARM)
    robot.order(Order.RESET, seed=1)
    assert robot.mode is Mode.STANDING
    assert not robot.armed
