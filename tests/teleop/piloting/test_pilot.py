"""A person's hands on real vehicles hover, move and stop, shaped smoothly, and replay bit for bit."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerial_il import robots
from aerial_il.core.errors import UnknownNameError
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.teleop.devices.scripted import Scripted
from aerial_il.teleop.input.frame import DeviceFrame
from aerial_il.teleop.input.mapping import MOTIONS, Intent
from aerial_il.teleop.piloting.assist import STALE_TICKS, fenced, within_fence
from aerial_il.teleop.piloting.command import Command, modes_of
from aerial_il.teleop.piloting.pilot import ManualPilot
from aerial_il.teleop.piloting.shaping import ACCELERATION, BRAKING, DEAD_ZONE, Shaper, without_dead_zone
from tests.teleop.hands import first, schedule, shipped, world

SCRIPT = schedule(
    (5, 60, ["forward+"]), (30, 80, ["lateral-", "precision"]), (60, 110, ["yaw+", "up-"]), (100, 101, ["mode"]),
    (105, 160, ["forward+", "grip+"]), (150, 151, ["mode"]), (155, 200, ["forward-", "lateral+"]),
)  # fmt: skip


def fly(env: BatchEnvironment, frames: list[DeviceFrame], seed: int = 5001) -> tuple[np.ndarray, ManualPilot]:
    """Return the states (T + 1, S) of a flight by ``frames``, and its pilot."""
    pilot = ManualPilot(env.spec, robots.get(env.spec.robot).vehicle, shipped("scripted"))
    obs = first(env.reset(seed))
    pilot.engage(obs)
    states = [env.get_state()[0]]
    for frame in frames:
        obs = first(env.step(pilot.act(frame, obs)[None]).obs)
        states.append(env.get_state()[0])
    return np.array(states), pilot


def frames_of(script, count: int) -> list[DeviceFrame]:
    device = Scripted(script, shipped("scripted"))
    return [device.frame() for _ in range(count)]


@pytest.mark.parametrize("level", ["ee_pose", "ee_delta", "base_joint", "velocity"])
def test_a_log_flown_again_is_the_same_flight_to_the_bit(level: str) -> None:
    env, frames = world(action=level, tier="gusts"), frames_of(SCRIPT, 200)
    once, _ = fly(env, frames)
    again, _ = fly(env, [DeviceFrame.from_row(frame.to_row()) for frame in frames])
    np.testing.assert_array_equal(once, again)
    frames[30] = replace(frames[30], held=0)
    other, _ = fly(env, frames)
    assert not np.array_equal(once[-1], other[-1]), "a log that differs by one key in one tick is another flight"
    np.testing.assert_array_equal(once[:31], other[:31])


@pytest.mark.parametrize("level", ["ee_pose", "ee_delta", "base_joint", "velocity"])
@pytest.mark.parametrize("robot", ["fa_hexa_arm4", "ua_quad_arm4"])
def test_it_hovers_flies_forward_along_its_heading_and_stops(robot: str, level: str) -> None:
    env = world(robot, action=level)
    script = schedule((50, 100, ["forward+"]))
    pilot = ManualPilot(env.spec, robots.get(robot).vehicle, shipped("scripted"), "base")
    obs = first(env.reset(5002))
    pilot.engage(obs)
    start, base = obs["base_pos"], []
    heading = np.array([obs["base_rot6d"][0], obs["base_rot6d"][1], 0.0])
    device = Scripted(script, shipped("scripted"))
    for _ in range(250):
        obs = first(env.step(pilot.act(device.frame(), obs)[None]).obs)
        base.append(obs["base_pos"])
    assert np.linalg.norm(base[49] - start) < 0.06, "hover hold"
    moved = base[-1] - start
    assert moved @ heading == pytest.approx(0.55, abs=0.15)
    assert np.linalg.norm(moved - (moved @ heading) * heading) < 0.12
    assert np.linalg.norm(base[-1] - base[-25]) < 0.02, "it stands"


def test_without_a_message_for_300_ms_the_vehicle_stays() -> None:
    env = world()
    frames = frames_of(schedule((0, 200, ["forward+"])), 50)
    pilot = ManualPilot(env.spec, robots.get(env.spec.robot).vehicle, shipped("scripted"))
    obs = first(env.reset(5003))
    pilot.engage(obs)
    commands, places = [], []
    for frame in [*frames, *[frames[-1]] * 150]:
        obs = first(env.step(pilot.act(frame, obs)[None]).obs)
        commands.append(pilot.command)
        places.append(obs["ee_pos"])
    assert commands[49 + STALE_TICKS - 1] != Command()
    assert all(command == Command() for command in commands[49 + STALE_TICKS :])
    assert np.linalg.norm(places[-1] - places[-40]) < 0.01


def test_nobody_flies_before_the_first_message() -> None:
    env = world()
    _, pilot = fly(env, [DeviceFrame()] * 3)
    assert pilot.dead


def test_engaging_commands_the_pose_that_is_there() -> None:
    env = world()
    obs = first(env.reset(5004))
    pilot = ManualPilot(env.spec, robots.get(env.spec.robot).vehicle, shipped("scripted"))
    pilot.engage(obs)
    action = pilot.act(DeviceFrame(seq=1), obs)
    np.testing.assert_allclose(action[:3], obs["ee_pos"], atol=1e-12)
    np.testing.assert_allclose(action[3:9], obs["ee_rot6d"], atol=1e-9)


def test_actions_of_keys_are_no_steps() -> None:
    env = world()
    pilot = ManualPilot(env.spec, robots.get(env.spec.robot).vehicle, shipped("scripted"))
    obs = first(env.reset(5005))
    pilot.engage(obs)
    actions = []
    for frame in frames_of(schedule((3, 40, ["forward+"])), 80):
        actions.append(pilot.act(frame, obs))
        obs = first(env.step(actions[-1][None]).obs)
    speeds = np.diff(np.array(actions)[:, :3], axis=0) / 0.02
    accelerations = np.linalg.norm(np.diff(speeds, axis=0), axis=1) / 0.02
    assert np.linalg.norm(speeds, axis=1).max() <= 0.41
    assert accelerations.max() < 0.4 * 0.31 / 0.02


def test_the_fence_slows_and_holds() -> None:
    assert fenced((1.0, 0.0, 0.0), (2.8, 0.0, 1.0))[0] == pytest.approx(0.5)
    assert fenced((1.0, 0.0, 0.0), (3.2, 0.0, 1.0))[0] == 0.0
    assert fenced((-1.0, 0.0, 0.0), (3.2, 0.0, 1.0))[0] == -1.0, "the way back is free"
    assert fenced((0.0, 0.0, -1.0), (0.0, 0.0, 0.03))[2] == 0.0
    assert within_fence((9.0, -9.0, -1.0)) == (3.0, -3.0, 0.03)


@pytest.mark.parametrize("level", ["rotor", "ctbr", "ee_poses"])
def test_levels_that_nobody_can_fly_are_refused(level: str) -> None:
    env = world()
    with pytest.raises(UnknownNameError, match="ee_pose"):
        ManualPilot(
            replace(env.spec, action=replace(env.spec.action, level=level)),
            robots.get("z1").vehicle,
            shipped("scripted"),
        )


def test_every_robot_has_modes_that_reach_all_its_joints() -> None:
    for name in robots.names():
        vehicle = robots.get(name).vehicle
        groups = [mode for mode in modes_of("base_joint", vehicle) if mode.startswith("joints")]
        reached = [j for mode in groups for j in range(int(mode.split()[1].split("-")[0]), int(mode.split("-")[1]) + 1)]
        assert reached == list(range(1, vehicle.num_joints + 1))


def test_a_key_takes_150_ms_from_rest_to_full() -> None:
    shaper, values = Shaper(), []
    for _ in range(10):
        values.append(shaper.step(Intent(digital={"forward": 1.0}))["forward"])
    assert values[:7] == sorted(values[:7])
    assert values[6] < 1.0
    assert values[7] == pytest.approx(1.0)
    assert values[0] < 0.2


def test_letting_go_ends_in_exact_rest() -> None:
    shaper = Shaper()
    for _ in range(20):
        shaper.step(Intent(digital={"forward": 1.0}))
    values = [shaper.step(Intent())["forward"] for _ in range(6)]
    assert values[-1] == 0.0


@given(st.floats(-DEAD_ZONE, DEAD_ZONE), st.floats(-DEAD_ZONE, DEAD_ZONE))
def test_the_dead_zone_is_round(x: float, y: float) -> None:
    result = without_dead_zone({"forward": x, "lateral": y})
    assert (result["forward"] == 0.0) == (x == 0.0 or (x * x + y * y) ** 0.5 <= DEAD_ZONE) or abs(
        result["forward"]
    ) < 1e-6


def test_outside_the_dead_zone_a_small_sideways_part_is_kept() -> None:
    result = without_dead_zone({"forward": 0.9, "lateral": 0.05})
    assert 0.0 < result["lateral"] < 0.05


@given(st.lists(st.tuples(*[st.floats(-1, 1)] * len(MOTIONS), st.sampled_from([-1.0, 0.0, 1.0])), max_size=40))
def test_shaped_motions_stay_in_bounds_and_never_jump(script: list) -> None:
    shaper, before = Shaper(), dict.fromkeys(MOTIONS, 0.0)
    for *axes, key in script:
        after = shaper.step(Intent(dict(zip(MOTIONS, axes, strict=True)), {"forward": key}))
        assert all(-1.0 <= value <= 1.0 for value in after.values())
        assert all(abs(after[m] - before[m]) <= max(ACCELERATION, BRAKING) + 1e-12 for m in MOTIONS)
        before = dict(after)
