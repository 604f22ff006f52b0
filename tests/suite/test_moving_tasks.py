"""Moving table, slung load and throw: what swings keeps its energy, and no short cut counts."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import aerial_il
from aerial_il import robots
from aerial_il.control.vehicle import GRAVITY
from aerial_il.core.arrays import length, planar_length
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.episode import measured
from aerial_il.suite.physics import episode_state
from aerial_il.suite.props.moving_table import SLIDES, TABLE_MASS_KG
from aerial_il.suite.props.slung_load import CABLE_M, LOAD_HALF_M
from aerial_il.suite.props.toss import BALL_RADIUS_M, BIN_RADIUS_M
from aerial_il.suite.tasks import carry_slung_load, pick_moving
from aerial_il.suite.tasks.toss_ball import fence_radius
from tests.contract.registered import batch, hold_actions

ROBOT = "fa_hexa_arm4"
PICK, CARRY = (ROBOT, "pick_moving"), (ROBOT, "carry_slung_load")
table_offset, table_vel = measured.vector(pick_moving.table_offset), measured.vector(pick_moving.table_vel)
through, untouched = measured.truth(carry_slung_load.through), measured.truth(carry_slung_load.gate_untouched)
eye, swing = measured.vector(carry_slung_load.eye), measured.number(carry_slung_load.swing)


def hold(worlds: BatchEnvironment, steps: int) -> np.ndarray:
    """Stay in place for ``steps``; return who succeeded at any of them, (n,)."""
    stay, success = hold_actions(worlds), np.zeros(worlds.num_envs, bool)
    for _ in range(steps):
        success |= worlds.step(stay).info["success"]
    return success


def put_free(worlds: BatchEnvironment, name: str, pos: np.ndarray, vel: np.ndarray | float = 0.0) -> None:
    """Put a free body of every world at ``pos`` (n, 3), upright, with a velocity."""
    view = worlds.simulation.view
    pose, speed = view.free_joint(name)
    view.qpos[:, pose] = np.concatenate([pos, np.tile([1.0, 0.0, 0.0, 0.0], (view.n, 1))], axis=1)
    view.qvel[:, speed], view.qvel[:, speed][:, :3] = 0.0, vel
    worlds.set_state(worlds.get_state())


def move_robot(worlds: BatchEnvironment, tool: np.ndarray) -> None:
    """Shift the robot of every world until its tool is at ``tool`` (n, 3), at rest."""
    view = worlds.simulation.view
    view.qpos[:, :3] += tool - view.tool_pos
    view.qvel[:, :6] = 0.0
    view.userdata[:, episode_state.CONTROLLER] = 0.0  # its references are where it is now
    worlds.set_state(worlds.get_state())


# pick_moving


def started(cell: tuple[str, str], num_envs: int = 3) -> BatchEnvironment:
    worlds = batch(*cell, num_envs=num_envs)
    worlds.reset(0)
    return worlds


def test_tables_differ_in_speed_and_course_and_never_stop() -> None:
    worlds = started(PICK, 16)
    view, speeds = worlds.simulation.view, []
    for _ in range(8):
        hold(worlds, 50)
        speeds.append(planar_length(table_vel(view)))
    fastest, slowest = np.max(speeds, axis=0), np.min(speeds, axis=0)
    assert fastest.min() > 0.04
    assert fastest.max() < 0.26
    assert np.ptp(fastest) > 0.1
    assert 2 < (slowest > 0.95 * fastest).sum() < 14, "some run round, some to and fro"


def test_a_table_loses_and_gains_no_energy() -> None:
    worlds = started(PICK, 16)
    view = worlds.simulation.view
    stiffness = view.worlds.bind("ctrl")[:, view.model.actuator(SLIDES[0]).id]

    def energy() -> np.ndarray:
        moving = TABLE_MASS_KG * planar_length(table_vel(view)) ** 2
        return 0.5 * (moving + stiffness * planar_length(table_offset(view)) ** 2)

    before = energy()
    hold(worlds, 400)
    np.testing.assert_allclose(energy(), before, rtol=0.02)


def test_a_cube_rides_on_a_table_without_sliding_on_it() -> None:
    worlds = started(PICK, 16)
    view = worlds.simulation.view

    def on_table() -> np.ndarray:
        return view.site_pos("cube") - view.site_pos("track") - table_offset(view)

    before = on_table()
    assert not hold(worlds, 400).any()
    assert length(on_table() - before).max() < 2e-3


def test_leaning_on_the_table_hardly_changes_its_course() -> None:
    """Twenty newtons, three times what a light vehicle can push with, for as long as a grasp takes."""
    worlds = started(PICK)
    model, data = worlds.model, mujoco.MjData(worlds.model)
    joint, speeds = data.joint(SLIDES[0]), []
    for push in (0.0, 20.0):
        mujoco.mj_resetData(model, data)
        data.qpos[2], joint.qvel[0], joint.qfrc_applied[0] = 3.0, 0.15, push
        for _ in range(250):
            mujoco.mj_step(model, data)
        speeds.append(joint.qvel[0])
    assert 0.01 < speeds[1] - speeds[0] < 0.05


@pytest.mark.parametrize("aside", [0.0, 0.10])
def test_a_cube_over_or_beside_the_bowl_does_not_count(aside: float) -> None:
    """Thrown through the bowl's rim in passing, or let fall beside it: the first moves on, the other is lost."""
    worlds = started(PICK)
    bowl = worlds.simulation.view.site_pos("bowl").copy()
    put_free(worlds, "cube", bowl + np.array([aside, 0.0, 0.045]), np.array([1.0, 0.0, 0.0]))
    assert not hold(worlds, 10).any()


def test_a_cube_that_is_held_in_the_bowl_is_not_placed() -> None:
    worlds = started(PICK)
    bowl = worlds.simulation.view.site_pos("bowl").copy()
    move_robot(worlds, bowl + np.array([0.0, 0.0, 0.06]))
    put_free(worlds, "cube", bowl + np.array([0.0, 0.0, 0.0281]))
    assert not hold(worlds, 60).any(), "the gripper has not backed off"


# carry_slung_load


def gate_point(worlds: BatchEnvironment, along: float, aside: float, height: float) -> np.ndarray:
    """(n, 3) point of the world at a place in the frame of the gate."""
    axes = worlds.simulation.view.site_mat("gate").reshape(-1, 3, 3)
    return worlds.simulation.view.site_pos("gate") + axes @ [along, aside, height]


def carry_along(worlds: BatchEnvironment, way: list[tuple[float, float, float]], tool_aside: float = 0.0) -> None:
    """Put load and robot to places in the gate's frame, the tool above the load, with a control step at each."""
    for along, aside, height in way:
        load = gate_point(worlds, along, aside, height)
        put_free(worlds, "load", load)
        above = np.array([0.0, 0.0, LOAD_HALF_M + 0.9 * CABLE_M])
        move_robot(worlds, load + above + gate_point(worlds, 0.0, tool_aside, 0.0) - gate_point(worlds, 0.0, 0.0, 0.0))
        worlds.step(hold_actions(worlds))


def set_down_at_goal(worlds: BatchEnvironment, steps: int = 60) -> np.ndarray:
    """Set the load down on the mark by hand, robot above; return who succeeded within ``steps``, (n,)."""
    goal = worlds.simulation.view.site_pos("goal").copy()
    put_free(worlds, "load", goal + np.array([0.0, 0.0, LOAD_HALF_M]))
    move_robot(worlds, goal + np.array([0.0, 0.0, 2.0 * LOAD_HALF_M + 0.9 * CABLE_M]))
    return hold(worlds, steps)


OVER_BEAM = 0.55
WAYS = {
    "through": ([(-0.05, 0.0, OVER_BEAM), (0.05, 0.0, OVER_BEAM)], 0.0, True),
    "not at all": ([], 0.0, False),
    "around it": ([(-0.05, 0.6, OVER_BEAM), (0.05, 0.6, OVER_BEAM)], 0.0, False),
    "under the beam": ([(-0.12, 0.0, 0.2), (0.12, 0.0, 0.2)], 0.0, False),
    "backwards": ([(0.05, 0.6, OVER_BEAM), (0.05, 0.0, OVER_BEAM), (-0.05, 0.0, OVER_BEAM)], 0.0, False),
    "there and back": ([(x, 0.0, OVER_BEAM) for x in (-0.05, 0.05, -0.05)], 0.0, False),
    "with the robot outside": ([(-0.05, 0.2, OVER_BEAM), (0.05, 0.2, OVER_BEAM)], 0.3, False),
    "through, then around it again": (
        [(-0.05, 0.0, OVER_BEAM), (0.05, 0.0, OVER_BEAM), (0.05, 0.6, OVER_BEAM), (-0.05, 0.6, OVER_BEAM)],
        0.0,
        False,
    ),
}


@pytest.mark.parametrize("way", WAYS)
def test_only_the_way_through_the_gate_counts(way: str) -> None:
    worlds = started(CARRY)
    places, tool_aside, counts = WAYS[way]
    carry_along(worlds, places, tool_aside)
    assert (through(worlds.simulation.view) == counts).all()
    assert (set_down_at_goal(worlds) == counts).all()


def test_one_touch_of_the_gate_spoils_the_episode() -> None:
    worlds = started(CARRY)
    carry_along(worlds, [(-0.05, 0.27, OVER_BEAM), (-0.03, 0.27, OVER_BEAM), *WAYS["through"][0]])
    assert through(worlds.simulation.view).all()
    assert not untouched(worlds.simulation.view).any()
    assert not set_down_at_goal(worlds).any()


def test_a_cable_over_the_beam_touches_it() -> None:
    worlds = started(CARRY)
    load = gate_point(worlds, -0.3, 0.0, LOAD_HALF_M)
    put_free(worlds, "load", load)
    for height in np.linspace(0.45, 0.9, 12):
        move_robot(worlds, gate_point(worlds, 0.3, 0.0, height))
        worlds.step(hold_actions(worlds))
    assert not untouched(worlds.simulation.view).any()


def test_a_load_on_the_mark_for_a_moment_is_not_set_down() -> None:
    worlds = started(CARRY)
    carry_along(worlds, WAYS["through"][0])
    assert not set_down_at_goal(worlds, 45).any()
    move_robot(worlds, worlds.simulation.view.tool_pos + np.array([0.25, 0.0, 0.0]))
    assert not hold(worlds, 60).any(), "the robot is not above it"


def test_a_swinging_load_gains_no_energy_and_the_cable_gives_little() -> None:
    worlds = started(CARRY)
    view = worlds.simulation.view
    tool = np.tile([-0.6, 0.0, 1.6], (view.n, 1))
    move_robot(worlds, tool)
    angle = np.deg2rad(30.0)
    offset = CABLE_M * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    put_free(worlds, "load", view.tip_pos + offset - [0.0, 0.0, LOAD_HALF_M])
    stay, swings, longest = hold_actions(worlds), [], 0.0
    for _ in range(300):
        worlds.step(stay)
        swings.append(swing(view))
        longest = max(longest, length(eye(view) - view.tip_pos).max())
    assert longest < CABLE_M + 2e-3
    assert np.max(swings[100:]) < np.max(swings[:50])


def test_a_dropped_load_is_caught_by_the_cable_and_nothing_explodes() -> None:
    worlds = started(CARRY)
    view = worlds.simulation.view
    tool = np.tile([-0.6, 0.0, 1.8], (view.n, 1))
    move_robot(worlds, tool)
    put_free(worlds, "load", tool + np.array([0.0, 0.1, -0.2]))
    stay, lowest = hold_actions(worlds), np.inf
    for _ in range(100):
        result = worlds.step(stay)
        lowest = min(lowest, view.site_pos("load")[:, 2].min())
    assert not result.info["crash"].any()
    assert lowest > 1.8 - CABLE_M - 2.0 * LOAD_HALF_M - 0.15, "the robot dips a little"
    assert length(eye(view) - view.tip_pos).max() < CABLE_M + 2e-3


def test_a_standing_load_stands_still() -> None:
    worlds = started(CARRY)
    before = worlds.simulation.view.site_pos("load").copy()
    hold(worlds, 100)
    assert length(worlds.simulation.view.site_pos("load") - before).max() < 1e-3


def test_the_expert_lifts_a_load_again_that_was_put_aside() -> None:
    worlds, expert = started(CARRY), aerial_il.expert(*CARRY)
    expert.attach(worlds)
    carry_along(worlds, WAYS["through"][0])
    beside = worlds.simulation.view.site_pos("goal") + np.array([-0.25, 0.1, LOAD_HALF_M])
    put_free(worlds, "load", beside)
    move_robot(worlds, beside + np.array([0.0, 0.0, 0.9]))
    success = np.zeros(3, bool)
    for _ in range(900):
        success |= worlds.step(expert.act({}), ~success).info["success"]
    assert success.all()


# toss_ball

TOSS = (ROBOT, "toss_ball")


def move_base_to(worlds: BatchEnvironment, away: float) -> None:
    """Shift the robot of every world until its base is ``away`` m from the bin's axis, on the side it is on."""
    view = worlds.simulation.view
    offset = (view.base_pos - view.site_pos("bin")) * [1.0, 1.0, 0.0]
    move_robot(worlds, view.tool_pos + (away / length(offset) - 1.0)[:, None] * offset)


def put_in_bin(worlds: BatchEnvironment, height: float = 0.09, vel: np.ndarray | float = 0.0) -> None:
    """Put the ball of every world into the bin."""
    put_free(worlds, "ball", worlds.simulation.view.site_pos("bin") + np.array([0.0, 0.0, height]), vel)


def test_a_ball_in_the_bin_for_half_a_second_counts() -> None:
    worlds = started(TOSS)
    put_in_bin(worlds)
    assert not hold(worlds, 20).any()
    assert hold(worlds, 20).all()


def test_a_base_inside_the_fence_before_the_ball_is_in_loses() -> None:
    worlds = started(TOSS)
    fence = fence_radius(worlds.simulation.robot)
    move_base_to(worlds, fence - 0.02)
    result = worlds.step(hold_actions(worlds))
    assert result.info["dropped"].all()
    move_base_to(worlds, fence + 0.5)
    put_in_bin(worlds)
    assert not hold(worlds, 60).any(), "what was lost stays lost"


def test_a_base_may_come_in_once_the_ball_is_in() -> None:
    worlds = started(TOSS)
    put_in_bin(worlds)
    hold(worlds, 15)
    move_base_to(worlds, fence_radius(worlds.simulation.robot) - 0.02)
    assert hold(worlds, 40).all()


def test_a_ball_on_the_ground_is_lost_and_a_held_one_does_not_count() -> None:
    worlds = started(TOSS)
    put_free(worlds, "ball", np.tile([0.9, 0.0, BALL_RADIUS_M], (3, 1)))
    for _ in range(5):
        result = worlds.step(hold_actions(worlds))
    assert result.info["dropped"].all()
    worlds.reset(0)
    put_in_bin(worlds)
    move_robot(worlds, worlds.simulation.view.site_pos("ball").copy())
    assert not hold(worlds, 40).any()


@pytest.mark.parametrize(("height", "sideways"), [(2.3, 0.8), (2.6, 0.0), (2.3, 1.5)])
def test_a_ball_that_falls_into_the_bin_stays_in_it(height: float, sideways: float) -> None:
    """As a throw arrives, from higher up and twice as fast: it neither bounces out nor passes through the floor."""
    worlds = started(TOSS, 16)
    angle = np.arange(16) * np.pi / 8
    vel = np.stack(
        [sideways * np.cos(angle), sideways * np.sin(angle), np.full(16, -np.sqrt(2.0 * GRAVITY * height))], axis=1
    )
    put_in_bin(worlds, 0.15, vel)
    assert hold(worlds, 200).all()


def test_no_robot_reaches_over_the_bin_from_outside_the_fence() -> None:
    for name in (robot for robot, task in aerial_il.list_cells() if task == "toss_ball"):
        robot = robots.get(name)
        stretched = robot.arm.reach + robot.gripper.finger_length + float(np.linalg.norm(robot.arm.mount))
        assert fence_radius(robot) - stretched >= BIN_RADIUS_M - 1e-9
