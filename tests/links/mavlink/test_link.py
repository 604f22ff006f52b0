"""A robot behind an autopilot is a link like any other: scripts and policies fly it, here and from another process."""

import subprocess
import sys

import numpy as np
import pytest

import aerial_il
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.latency import Latency
from aerial_il.links.environment import LinkedEnvironment
from aerial_il.links.link import Link, LinkError, Mode, Order, RefusedError
from aerial_il.links.mavlink.bench import Bench
from aerial_il.links.mavlink.link import Mavlink
from aerial_il.links.pilot import LinkPilot
from aerial_il.links.robot import SimulatedRobot
from aerial_il.links.vehicle import Vehicle
from tests.links.test_fly import ROBOT, TASK, fresh_policy

pytest.importorskip("pymavlink", reason="pymavlink is not installed: pip install 'aerial_il[mavlink]'")
FREE_PORT = 0


def linked(**settings: object) -> Link:
    return Mavlink(**settings).connect(lambda: SimulatedRobot(ROBOT, TASK))  # pyright: ignore[reportArgumentType]


def flown(seed: int) -> list[np.ndarray]:
    env, pilot = LinkedEnvironment(linked()), LinkPilot(fresh_policy("mlp"))
    pilot.attach(env)
    obs, seen = env.reset(seed), []
    pilot.reset()
    for _ in range(40):
        obs = env.step(pilot.act(obs)).obs
        seen.append(np.concatenate([value[0] for value in obs.values()]))
    env.close()
    return seen


def test_a_policy_flies_it_and_the_same_again() -> None:
    first, again, other = flown(3), flown(3), flown(4)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_the_tool_is_where_the_simulator_has_it() -> None:
    link = linked()
    link.order(Order.ARM)
    link.order(Order.TAKE_OFF, height_m=0.0)
    for _ in range(20):
        link.step()
    reading = link.read()
    assert reading is not None
    true = link._bench.world.env.observe()  # pyright: ignore[reportAttributeAccessIssue]
    assert np.linalg.norm(reading.obs["ee_pos"] - true["ee_pos"][0]) < 0.03
    assert np.abs(reading.obs["ee_rot6d"] - true["ee_rot6d"][0]).max() < 0.05
    assert set(reading.obs) == set(link.spec.observation.names)
    link.close()


def test_it_shows_and_takes_things_late() -> None:
    late = Latency(observation_delay_ms=60, action_delay_ms=40)
    link = Mavlink().connect(lambda: SimulatedRobot(ROBOT, TASK, latency=late))
    link.order(Order.ARM)
    link.order(Order.TAKE_OFF, height_m=0.0)
    for _ in range(10):
        link.send("velocity", np.array([0.5, 0.0, 0.0, 0.0, *np.zeros(4), 1.0]))
        link.step()
    reading = link.read()
    assert reading is not None
    now = link._client.state.stamp  # pyright: ignore[reportAttributeAccessIssue]
    assert now - reading.stamp_s == pytest.approx(0.06)
    link.close()
    with pytest.raises(InvalidValueError, match="lockstep"):
        Mavlink(lockstep=False).connect(lambda: SimulatedRobot(ROBOT, TASK, latency=late))


def test_the_ten_lines_fly_it() -> None:
    with Vehicle(linked()) as vehicle:
        start = vehicle.state
        vehicle.arm()
        vehicle.take_off(0.3)
        vehicle.go_to(np.add(vehicle.state.position, [0.3, 0.1, 0.2]))
        vehicle.tool_to(np.add(vehicle.state.tool, [0.0, 0.1, 0.0]), within_m=0.03)
        vehicle.move_arm(np.add(vehicle.state.joints, 0.1))
        vehicle.land()
        assert vehicle.state.mode is Mode.STANDING
        assert np.linalg.norm(vehicle.state.position - start.position) < 0.1


def test_what_is_no_set_point_of_it_is_refused() -> None:
    link = linked()
    for level, action in (("rotor", np.zeros(9)), ("ee_pose", np.full(10, np.nan)), ("velocity", np.zeros(3))):
        with pytest.raises(RefusedError):
            link.send(level, action)
    link.close()


def test_from_elsewhere_it_shows_itself_and_no_objects() -> None:
    bench = Bench(ROBOT, TASK, port=14_571, place="mocap")
    link = Mavlink(robot=ROBOT, port=14_571).connect(lambda: pytest.fail("none is made here"), level="ee_pose")
    try:
        assert "target_pos" not in link.spec.observation.names
        with pytest.raises(InvalidValueError, match="target_pos"):
            fresh_policy("mlp").check(link.spec)
        with pytest.raises(RefusedError, match="not set back"):
            link.order(Order.RESET, seed=1)
        with Vehicle(link) as vehicle:
            vehicle.arm()
            vehicle.take_off(0.2)
            vehicle.tool_to(np.add(vehicle.state.tool, [0.1, 0.0, 0.0]), within_m=0.05)
            vehicle.land()
    finally:
        bench.close()


def test_the_autopilot_of_another_arm_is_refused() -> None:
    bench = Bench("big_four_z1", TASK, port=14_573, place="mocap")
    try:
        with pytest.raises(LinkError, match="6 joints answers, and 4 were expected"):
            Mavlink(robot=ROBOT, port=14_573).connect(lambda: pytest.fail("none is made here"))
    finally:
        bench.close()


def test_a_served_robot_is_flown_from_another_process() -> None:
    command = [sys.executable, "-m", "aerial_il", "simulate", "link=mavlink", "link.port=14572", f"robot={ROBOT}"]
    robot = subprocess.Popen([*command, "task=reach"])
    try:
        with aerial_il.vehicle("mavlink", robot=ROBOT, port=14_572) as vehicle:
            assert vehicle.state.mode is Mode.STANDING
            vehicle.arm()
            vehicle.take_off(0.2)
            vehicle.land()
    finally:
        robot.terminate()
        robot.wait()


def test_where_no_autopilot_sends_it_is_said() -> None:
    with pytest.raises(LinkError):
        Mavlink(robot=ROBOT, port=FREE_PORT, patience_s=0.2).connect(lambda: pytest.fail("none is made here"))


def test_a_script_says_whose_autopilot_it_is() -> None:
    with pytest.raises(InvalidValueError, match="robot=NAME"):
        aerial_il.vehicle("mavlink")


@pytest.mark.parametrize("settings", [{"place": "stars"}, {"speed": 0.0}, {"port": 70_000}])
def test_wrong_settings_are_refused(settings: dict) -> None:
    with pytest.raises(InvalidValueError):
        Mavlink(**settings)
