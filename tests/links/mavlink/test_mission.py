"""Whole missions over real sockets: simulator, stand-in autopilot, offboard client. Never with a PX4."""

import numpy as np
import pytest

from aerial_il import robots
from aerial_il.control.vehicle import GRAVITY
from aerial_il.links.link import Mode
from aerial_il.links.mavlink.bench import Bench
from aerial_il.links.mavlink.client import OffboardClient
from tests.links.mavlink.conftest import Fly

ROBOTS = ("ua_quad_arm4", "big_four_z1", "fa_hexa_arm4")


def mission(bench: Bench, client: OffboardClient) -> np.ndarray:
    """Fly to two points, move the arm and land; return errors of the estimate (n, 3), m."""
    wrong, step = [], client.step

    def watched() -> None:
        step()
        if client.state.flying:
            wrong.append(bench.autopilot.estimator.estimate.pos - bench.world.motion.pos)

    client.step = watched  # type: ignore[method-assign]
    state = client.state
    client.arm()
    client.take_off(0.4)
    client.go_to(state.pos + np.array([0.5, -0.3, 0.3]), state.heading + 0.3)
    client.go_to(state.pos + np.array([-0.4, 0.3, 0.5]), state.heading - 0.2)
    client.move_arm(state.joints + 0.2)
    client.grip(0.0)
    client.land()
    return np.array(wrong)


def off_cradle(bench: Bench) -> float:
    assert bench.world.held
    assert not bench.world.crashed
    return float(np.linalg.norm(bench.world.motion.pos - bench.world.cradle))


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_mission_in_gusts_ends_in_the_cradle(fly: Fly, robot: str) -> None:
    bench, client = fly(robot, tier="gusts", seed=1)
    wrong = mission(bench, client)
    assert off_cradle(bench) < 0.1
    assert not client.state.armed
    assert np.sqrt(np.mean(np.square(wrong).sum(axis=1))) < 0.1


def test_with_motion_capture_it_lands_to_the_centimetre(fly: Fly) -> None:
    bench, client = fly(place="mocap", seed=1)
    wrong = mission(bench, client)
    assert off_cradle(bench) < 0.04
    assert np.sqrt(np.mean(np.square(wrong).sum(axis=1))) < 0.01


def test_a_mission_repeats_bit_for_bit(fly: Fly) -> None:
    flown = []
    for _ in range(2):
        bench, client = fly(tier="gusts", seed=2)
        wrong = mission(bench, client)
        state, motion = client.state, bench.world.motion
        flown.append(np.concatenate([wrong.ravel(), state.pos, state.quat, motion.pos, motion.quat, [state.stamp]]))
    np.testing.assert_array_equal(*flown)


def test_seeds_make_missions_differ(fly: Fly) -> None:
    first, other = (mission(*fly(tier="gusts", seed=seed)) for seed in (2, 3))
    assert first.shape != other.shape or (first != other).any()


def test_velocities_and_rates_are_flown(fly: Fly) -> None:
    _, client = fly()
    client.arm()
    client.take_off(0.4)
    before = client.state
    client.velocity([0.4, -0.2, 0.1], seconds=1.5)
    np.testing.assert_allclose(client.state.vel, [0.4, -0.2, 0.1], atol=0.06)
    assert client.state.pos[0] > before.pos[0] + 0.3
    client.velocity([0.0, 0.0, 0.0], 0.5, seconds=1.5)
    np.testing.assert_allclose(client.state.heading - before.heading, 0.75, atol=0.15)
    turned = client.state.heading
    weight = robots.get("ua_quad_arm4").vehicle.mass * GRAVITY
    client.rates(weight, [0.0, 0.0, -0.6], seconds=0.5)
    np.testing.assert_allclose(client.state.heading - turned, -0.3, atol=0.12)
    client.order("hover")
    assert client.state.flying


def test_arm_and_gripper_move_as_told(fly: Fly) -> None:
    _, client = fly()
    client.arm()
    client.take_off(0.3)
    wanted = client.state.joints + np.array([0.3, 0.2, -0.2, 0.1])
    client.move_arm(wanted)
    np.testing.assert_allclose(client.state.joints, wanted, atol=0.06)
    client.grip(0.0)
    assert client.state.opening < 0.1
    client.grip(0.5)
    np.testing.assert_allclose(client.state.opening, 0.5, atol=0.1)


def test_without_set_points_it_hovers(fly: Fly) -> None:
    bench, client = fly()
    client.arm()
    client.take_off(0.4)
    client.velocity([0.6, 0.0, 0.0], seconds=1.0)
    assert client.state.mode is Mode.FLYING
    heard = client.state.stamp
    while client.state.mode is Mode.FLYING:
        client.step()
    np.testing.assert_allclose(client.state.stamp - heard, 0.22, atol=0.021)
    for _ in range(150):
        client.step()
    assert client.state.mode is Mode.HOLDING
    assert np.linalg.norm(bench.world.motion.vel) < 0.1
    client.velocity([0.0, 0.3, 0.0], seconds=0.2)
    assert client.state.mode is Mode.FLYING


def test_a_hover_that_was_ordered_outlasts_set_points(fly: Fly) -> None:
    _, client = fly()
    client.arm()
    client.take_off(0.4)
    client.velocity([0.3, 0.0, 0.0], seconds=0.2)
    client.order("hover")
    client.velocity([0.3, 0.0, 0.0], seconds=0.2)
    assert client.state.mode is Mode.HOLDING
    client.order("follow")
    client.velocity([0.3, 0.0, 0.0], seconds=0.2)
    assert client.state.mode is Mode.FLYING


def test_it_takes_off_again_from_where_it_landed(fly: Fly) -> None:
    bench, client = fly(seed=4)
    for _ in range(2):
        client.arm()
        client.take_off(0.3)
        client.land()
        assert off_cradle(bench) < 0.1


def test_over_udp_time_does_not_wait(fly: Fly) -> None:
    client = OffboardClient("ua_quad_arm4", port=0)
    bench = Bench(port=client.port, speed=4.0)
    try:
        client.connect()
        client.arm()
        client.take_off(0.3)
        risen = client.state.pos[2] - bench.world.cradle[2]
        client.land()
    finally:
        bench.close()
        client.close()
    assert 0.2 < risen < 0.45
    assert off_cradle(bench) < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("robot", ROBOTS)
def test_twenty_of_twenty_missions_succeed(fly: Fly, robot: str) -> None:
    landed, rms = [], []
    for seed in range(10_000, 10_020):
        bench, client = fly(robot, tier="gusts", seed=seed)
        rms.append(np.sqrt(np.mean(np.square(mission(bench, client)).sum(axis=1))))
        landed.append(off_cradle(bench) < 0.1)
    assert sum(landed) == 20
    assert max(rms) < 0.1
