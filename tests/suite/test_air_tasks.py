"""Tasks in the air: what counts as settled, landed, reached, and as a lap of the track."""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

import aerial_il
from aerial_il.control.vehicle import GRAVITY
from aerial_il.experts.track import TrackExpert
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.episode import measured
from aerial_il.suite.props.skids import STAND_M
from aerial_il.suite.tasks import hover, reach, track
from aerial_il.suite.tasks.land import HARDEST, SOFT_M_S
from aerial_il.suite.tasks.reach import ANGLE_TOLERANCE_RAD, POSITION_TOLERANCE_M, TASK, reached
from tests.contract.registered import batch, hold_actions

CELL = ("quad", "hover")
attitude_cosine = measured.number(hover.attitude_cosine)


def test_it_starts_off_the_point_moving_leaning_and_turning() -> None:
    worlds = batch(*CELL, num_envs=16)
    obs = worlds.reset(0)
    distance = np.linalg.norm(obs["base_to_target"], axis=1)
    assert (hover.STEP_M[0] - 1e-9 <= distance).all()
    assert (distance <= hover.STEP_M[1] + 1e-9).all()
    lean = np.arccos(worlds.simulation.view.base_mat[:, 8])
    assert hover.TILT_RAD / 2 < lean.max() <= hover.TILT_RAD
    assert hover.SPEED_M_S / 2 < np.linalg.norm(obs["base_vel"], axis=1).max() <= hover.SPEED_M_S
    assert hover.RATE_RAD_S / 2 < np.linalg.norm(obs["base_angvel"], axis=1).max() <= hover.RATE_RAD_S


def put_at_target(worlds: BatchEnvironment, yaw_deg: float = 0.0, lean_deg: float = 0.0) -> None:
    """Put every base at rest on its target, ``yaw_deg`` off the heading asked for and leaning forward."""
    view = worlds.simulation.view
    ahead = view.site_mat("target")
    half_yaw = 0.5 * (np.arctan2(ahead[:, 3], ahead[:, 0]) + np.deg2rad(yaw_deg))
    half_lean = 0.5 * np.deg2rad(lean_deg)
    (cy, sy), (cl, sl) = ((np.cos(half), np.sin(half)) for half in (half_yaw, half_lean))
    view.qpos[:, :3] = view.site_pos("target")
    view.qpos[:, 3:7] = np.stack([cy * cl, -sy * sl, cy * sl, sy * cl], axis=1)
    view.qvel[:] = 0.0
    worlds.set_state(worlds.get_state())


@pytest.mark.parametrize(
    ("yaw_deg", "lean_deg", "settled"),
    [(0.0, 0.0, True), (2.5, 0.0, True), (0.0, 2.5, True), (3.5, 0.0, False), (0.0, 3.5, False), (2.5, 2.5, False)],
)
def test_attitude_is_heading_and_tilt(yaw_deg: float, lean_deg: float, settled: bool) -> None:
    worlds = batch(*CELL)
    worlds.reset(3)
    put_at_target(worlds, yaw_deg, lean_deg)
    angle = np.degrees(np.arccos(attitude_cosine(worlds.simulation.view)))
    np.testing.assert_allclose(angle, np.hypot(yaw_deg, lean_deg), atol=0.01)
    assert (worlds.simulation.reassess().subtasks[:, 3] == settled).all()


def test_in_wind_the_trimmed_attitude_leans_against_it() -> None:
    worlds = batch(*CELL)
    worlds.reset(3)
    put_at_target(worlds)
    view = worlds.simulation.view
    view.air_force[:, 1] = 0.1 * view.robot.vehicle.mass * GRAVITY
    angle = np.arccos(attitude_cosine(view))
    np.testing.assert_allclose(angle, np.arctan(0.1), atol=1e-6)


DROPS_M = (0.005, 0.02, 0.04, 0.10, 0.30)


def dropped() -> tuple[BatchEnvironment, list[np.ndarray]]:
    """Return worlds in which the base fell on the pad from so many heights, rotors off, and its heights on the way."""
    worlds = aerial_il.load_batch("quad", "land", num_envs=len(DROPS_M), action="rotor", num_threads=1)
    worlds.reset(0)
    view = worlds.simulation.view
    view.qpos[:, :3] = view.mocap_pos[:, view.mocap_id("pad")] + np.array([[0.0, 0.0, STAND_M + h] for h in DROPS_M])
    view.qpos[:, 3:7], view.qvel[:] = [1.0, 0.0, 0.0, 0.0], 0.0
    view.thrust[:] = 0.0
    off = np.zeros((len(DROPS_M), 4))
    heights = []
    for _ in range(100):
        result = worlds.step(off)
        heights.append(view.base_pos[:, 2].copy())
    heights.append(result.info["success"])
    return worlds, heights


def test_it_rests_on_its_skids_and_only_soft_landings_count() -> None:
    worlds, (*heights, success) = dropped()
    np.testing.assert_allclose(heights[-1], STAND_M, atol=1e-3)
    assert np.ptp(heights[-20:], axis=0).max() < 1e-4, "it neither sinks nor bounces"
    hardest = worlds.simulation.view.task_state[:, HARDEST]
    fallen = np.sqrt(2.0 * 9.81 * np.array(DROPS_M))
    np.testing.assert_allclose(hardest, fallen, atol=9.81 * 0.03)  # as seen up to a control step before
    np.testing.assert_array_equal(success, hardest <= SOFT_M_S)
    assert success[0]
    assert not success[-1]


def test_standing_is_no_crash_and_lying_is_one() -> None:
    worlds, _ = dropped()
    assert not worlds.simulation.reassess().crash.any()
    view = worlds.simulation.view
    view.qpos[:, 2], view.qpos[:, 3:7] = 0.1, [np.cos(0.6), np.sin(0.6), 0.0, 0.0]  # 69 degrees: a rotor in the ground
    result = worlds.step(np.zeros((len(DROPS_M), 4)))
    assert result.info["crash"].all()


@pytest.mark.parametrize("task", ["take_off", "land"])
def test_arms_have_no_room_for_landing_gear(task: str) -> None:
    assert [robot for robot, other in aerial_il.list_cells() if other == task] == ["quad"]


HERE = np.array([[0.1, 0.2, 0.9, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]])


def turned(axis: int, angle_rad: float) -> np.ndarray:
    """Return the pose turned about one of its axes."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.eye(3)
    rotation[i, i], rotation[i, j], rotation[j, i], rotation[j, j] = c, -s, s, c
    return np.concatenate([HERE[:, :3], rotation[:, 0][None], rotation[:, 1][None]], axis=1)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("share", [1.0, 0.5, 0.1])
def test_the_angle_that_passes_is_that_share_about_every_axis(axis: int, share: float) -> None:
    for factor, paid in ((0.99, 1.0), (1.01, 0.0)):
        pose = turned(axis, factor * share * ANGLE_TOLERANCE_RAD)
        assert reached(pose, HERE, share) == paid


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_the_distance_that_passes_is_that_share(share: float) -> None:
    for factor, paid in ((0.99, 1.0), (1.01, 0.0)):
        moved = HERE.copy()
        moved[:, 1] += factor * share * POSITION_TOLERANCE_M
        assert reached(moved, HERE, share) == paid


def test_the_task_tells_how_to_be_stricter() -> None:
    assert TASK.goal is not None
    assert TASK.goal.within is reached


def dense(away_m: np.ndarray, turned_deg: np.ndarray) -> np.ndarray:
    """Return the dense reward, (n,), of tools ``away_m`` from their targets and ``turned_deg`` from their attitude."""
    worlds = batch("z1", "reach", num_envs=len(away_m))
    worlds.reset(0)
    view = worlds.simulation.view
    target, tool = view.mocap_id("target"), np.array(view.tool_mat)
    view.mocap_pos[:, target] = view.tool_pos + np.stack([away_m, 0 * away_m, 0 * away_m], axis=1)
    for world, angle in enumerate(np.deg2rad(turned_deg)):
        quat, turn = np.empty(4), np.array([math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)])
        mujoco.mju_mat2Quat(quat, tool[world])
        mujoco.mju_mulQuat(view.mocap_quat[world, target], quat, turn)
    worlds.set_state(worlds.get_state())
    np.testing.assert_allclose(measured.number(reach.cosine)(view), np.cos(np.deg2rad(turned_deg)), atol=1e-6)
    return measured.number(reach.reward)(view)


def test_the_dense_reward_pays_for_the_last_degrees() -> None:
    degrees = np.array([0.0, 10.0, 20.0, 45.0, 90.0])
    by_angle = dense(np.zeros(5), degrees)
    assert by_angle[0] == pytest.approx(1.0)
    assert (np.diff(by_angle) < -0.05).all(), "each of these pays"
    by_distance = dense(np.array([0.0, 0.02, 0.04, 0.3, 0.6]), np.zeros(5))
    assert (np.diff(by_distance) < -0.05).all()


TRACK = ("ua_quad_arm4", "track")


def test_the_target_goes_where_the_preview_says_and_comes_round() -> None:
    worlds = batch(*TRACK)
    first = worlds.reset(7)
    hover = hold_actions(worlds)
    announced = first["tool_to_preview"][:, :3] + first["ee_pos"]
    lap = np.ceil(track.FULL_LAP / np.abs(worlds.simulation.view.task_state[:, track.RATE]) / 0.02)
    positions = []
    for _ in range(int(lap.max()) + 1):
        obs = worlds.step(hover).obs
        positions.append(obs["target_pos"])
        if len(positions) == 10:
            np.testing.assert_allclose(obs["target_pos"], announced, atol=1e-9)
    path = np.array(positions)
    speed = np.linalg.norm(np.diff(path, axis=0), axis=2).max(axis=0) / 0.02
    assert ((speed > track.SPEED_M_S[0] - 0.01) & (speed < track.SPEED_M_S[1] + 0.01)).all()
    for world in range(3):
        gap = np.linalg.norm(path[int(lap[world]) - 1, world] - first["target_pos"][world])
        assert gap < track.SPEED_M_S[1] * 0.02, "one lap later it is within a step of where it started"


def test_a_tool_that_stands_still_never_completes_a_lap() -> None:
    worlds = batch(*TRACK)
    obs = worlds.reset(7)
    hover = np.concatenate([obs["target_pos"], obs["ee_rot6d"], np.ones((3, 1))], axis=1)
    while not worlds.simulation.reassess().truncated.any():
        assert not worlds.step(hover).info["success"].any()


def test_losing_the_target_breaks_the_lap_off() -> None:
    worlds = batch(*TRACK)
    expert = TrackExpert()
    expert.attach(worlds)
    worlds.reset(7)
    expert.reset()
    for _ in range(200):
        worlds.step(expert.act({}))
    memory = worlds.simulation.view.task_state
    assert (memory[:, track.LAP] > 0.5).all()
    while (memory[:, track.LAP] > 0.0).any():
        worlds.step(expert.act({}) + np.eye(10)[2] * 0.3)
    assert not worlds.step(expert.act({})).info["subtasks"][:, 1:].any()
