"""A script flies a robot in a few lines, the same over links that differ."""

from collections.abc import Iterator

import numpy as np
import pytest

import aerial_il
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.links.link import LinkError, Mode, RefusedError
from aerial_il.links.robot import SimulatedRobot
from aerial_il.links.simulated.link import Simulated
from aerial_il.links.vehicle import Vehicle

CLOCKS = [{"clock": "lockstep"}, {"clock": "wall", "speed": 5.0}]


@pytest.mark.parametrize("clock", CLOCKS, ids=["lockstep", "wall"])
@pytest.mark.parametrize("robot", ["ua_quad_arm4", "fa_hexa_arm4", "big_four_z1"])
def test_the_ten_lines(robot: str, clock: dict) -> None:
    with aerial_il.vehicle(robot=robot, **clock) as vehicle:
        start = vehicle.state
        vehicle.arm()
        vehicle.take_off(0.3)
        vehicle.go_to(np.add(start.position, [0.3, 0.2, 0.4]), heading=start.heading + 0.3)
        assert np.linalg.norm(vehicle.state.position - start.position - [0.3, 0.2, 0.4]) < 0.08
        vehicle.move_arm(start.joints + 0.1)
        np.testing.assert_allclose(vehicle.state.joints, start.joints + 0.1, atol=0.08)
        vehicle.grip(0.0)
        assert vehicle.state.opening < 0.1
        aim = np.add(vehicle.state.tool, [0.05, 0.0, 0.05])
        vehicle.tool_to(aim)
        assert np.linalg.norm(vehicle.state.tool - aim) < 0.05
        vehicle.land()
        assert vehicle.state.mode is Mode.STANDING
        assert np.linalg.norm(vehicle.state.position - start.position) < 0.03


def test_a_quad_without_an_arm_flies_a_path() -> None:
    with aerial_il.vehicle(robot="quad", task="hover") as vehicle:
        vehicle.arm()
        vehicle.take_off()
        start = vehicle.state.position
        vehicle.follow([np.add(start, [0.3, 0, 0]), [*np.add(start, [0.3, 0.3, 0]), 0.5]])
        vehicle.fly([-0.3, 0.0, 0.0], yaw_rate=0.2, seconds=1.0)
        assert vehicle.state.velocity[0] == pytest.approx(-0.3, abs=0.1)
        vehicle.hover(1.0)
        vehicle.land()


def test_what_does_not_arrive_or_is_refused_is_said() -> None:
    with aerial_il.vehicle() as vehicle:
        with pytest.raises(RefusedError, match="not armed"):
            vehicle.take_off()
        with pytest.raises(RefusedError, match="take_off"):
            vehicle.go_to([0.0, 0.0, 1.5])
        vehicle.arm()
        vehicle.take_off()
        with pytest.raises(LinkError, match=r"did not reach .* within 2 s: base at"):
            vehicle.go_to([2.9, 0.0, 1.0], timeout_s=2.0)
        with pytest.raises(RefusedError, match=r"base_x would be 50; it must lie in \[-3, 3\]"):
            vehicle.go_to([50.0, 0.0, 1.0])
        vehicle.land()


@pytest.mark.parametrize(
    ("call", "numbers", "word"),
    [
        ("go_to", {"position": [1.0, 2.0]}, "position is .* 3 finite numbers"),
        ("go_to", {"position": [np.nan, 0.0, 1.0]}, "position"),
        ("go_to", {"position": [0.0, 0.0, 1.0], "heading": np.inf}, "heading is .* 1 finite number"),
        ("go_to", {"position": [0.0, 0.0, 1.0], "timeout_s": np.nan}, "timeout_s"),
        ("move_arm", {"joints": [0.0, 0.0]}, "joints is .* 4 finite numbers"),
        ("tool_to", {"position": "up"}, "position"),
        ("tool_to", {"position": [0.0, 0.0, 1.0], "rot6d": [1.0, 0.0, 0.0]}, "rot6d"),
        ("fly", {"velocity": [0.0, 0.0, 0.0], "seconds": np.nan}, "seconds"),
        ("hover", {"seconds": np.nan}, "seconds"),
        ("grip", {"opening": np.nan}, "opening"),
    ],
)
def test_wrong_numbers_are_refused_and_change_nothing(hovering: Vehicle, call: str, numbers: dict, word: str) -> None:
    with pytest.raises(InvalidValueError, match=word):
        getattr(hovering, call)(**numbers)
    hovering.hover(0.1)


@pytest.fixture(scope="module")
def hovering() -> Iterator[Vehicle]:
    with aerial_il.vehicle() as vehicle:
        vehicle.arm()
        vehicle.take_off()
        yield vehicle


def test_a_crash_ends_a_command() -> None:
    with aerial_il.vehicle() as vehicle:
        vehicle.arm()
        vehicle.take_off()
        with pytest.raises(LinkError, match="crashed; it was to fly on"):
            vehicle.fly([1.5, 0.0, 0.0], seconds=10.0)


def test_over_a_link_that_loses_much_it_arrives_too() -> None:
    link = Simulated(loss=0.3).connect(lambda: SimulatedRobot("ua_quad_arm4", "reach"))
    with Vehicle(link) as vehicle:
        vehicle.arm()
        vehicle.take_off()
        vehicle.go_to(np.add(vehicle.state.position, [0.4, 0.0, 0.0]))
        vehicle.land()


def test_unknown_links_and_settings_are_named() -> None:
    with pytest.raises(UnknownNameError, match="simulated"):
        aerial_il.vehicle("pigeon")
    with pytest.raises((InvalidValueError, UnknownNameError), match="clock"):
        aerial_il.vehicle(clock="sundial")
