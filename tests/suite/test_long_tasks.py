"""Long tasks cannot be cheated: no order but the one shown, no cube without a door, no door that is not shut."""

from __future__ import annotations

import numpy as np
import pytest

import aerial_il
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.props import CUBE_HALF_M, TABLE_HEIGHT_M
from aerial_il.suite.props.cabinet import HOOD_M, WALL_M
from aerial_il.suite.props.peg import PEG_LENGTH_M
from aerial_il.suite.tasks import cabinet_retrieve, restock, sort_pegs
from aerial_il.suite.tasks.cabinet_retrieve import OPEN_ENOUGH_RAD
from aerial_il.suite.tasks.sort_pegs import AREA_HIGH, COLOURS, IN, SHOWN_S, SPOILED, TURN
from tests.contract.registered import batch, fly_until_solved, hold_actions

ROBOT = "fa_hexa_arm4"
PEGS = tuple(COLOURS)
UPRIGHT = (1.0, 0.0, 0.0, 0.0)
ON_ITS_SIDE = (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)


def started(task: str, seed: int = 30) -> BatchEnvironment:
    """Worlds at the start, the robots out of the way."""
    worlds = batch(ROBOT, task)
    worlds.reset(seed)
    view = worlds.simulation.view
    view.qpos[:, 2] += 0.4
    worlds.set_state(worlds.get_state())
    return worlds


def put(worlds: BatchEnvironment, name: str, pos: np.ndarray, quat: tuple[float, ...] = UPRIGHT) -> None:
    """Put a loose object of every world at ``pos`` (n, 3), at rest."""
    view = worlds.simulation.view
    pose, speed = view.free_joint(name)
    view.qpos[:, pose] = np.concatenate([pos, np.tile(quat, (view.n, 1))], axis=1)
    view.qvel[:, speed] = 0.0
    worlds.set_state(worlds.get_state())


def wait(worlds: BatchEnvironment, seconds: float) -> dict[str, np.ndarray]:
    """Hover; return what was ever so: who succeeded, who lost, (n,) bool."""
    hover, ever = hold_actions(worlds), {"success": np.zeros(3, bool), "dropped": np.zeros(3, bool)}
    for _ in range(round(seconds / worlds.spec.control_dt_s)):
        info = worlds.step(hover).info
        ever = {name: ever[name] | info[name] for name in ever}
    return ever


# sort_pegs


def peg_of_turn(worlds: BatchEnvironment, turn: int) -> np.ndarray:
    """(n,) number of the peg whose turn it is, from 1 on."""
    return (worlds.simulation.view.task_state[:, TURN : TURN + 3] == turn).argmax(axis=1)


def drop_in(worlds: BatchEnvironment, pegs: np.ndarray, holes: np.ndarray) -> dict[str, np.ndarray]:
    """Let go of one peg (n,) of each world in the mouth of one hole (n,), and wait until it is at the bottom."""
    view = worlds.simulation.view
    mouths = np.stack([view.site_pos(f"hole_{name}") for name in PEGS], axis=1)[np.arange(3), holes]
    start = np.concatenate([mouths + np.array([5e-4, 0.0, 0.5 * PEG_LENGTH_M]), np.tile(UPRIGHT, (3, 1))], axis=1)
    for k, name in enumerate(PEGS):
        pose, speed = view.free_joint(f"peg_{name}")
        view.qpos[pegs == k, pose] = start[pegs == k]
        view.qvel[pegs == k, speed] = 0.0
    worlds.set_state(worlds.get_state())
    return wait(worlds, 0.8)


def test_the_order_shown_is_the_order_that_counts() -> None:
    worlds = started("sort_pegs")
    for turn in (1, 2, 3):
        peg = peg_of_turn(worlds, turn)
        ever = drop_in(worlds, peg, peg)
        assert not ever["dropped"].any()
        assert ever["success"].all() == (turn == 3)
    assert worlds.simulation.reassess().subtasks[:, 1::2].all()


@pytest.mark.parametrize("first", [2, 3])
def test_a_peg_before_its_turn_ends_the_episode(first: int) -> None:
    worlds = started("sort_pegs")
    peg = peg_of_turn(worlds, first)
    assert drop_in(worlds, peg, peg)["dropped"].all()


def test_a_peg_in_the_hole_of_another_ends_the_episode() -> None:
    worlds = started("sort_pegs")
    assert drop_in(worlds, peg_of_turn(worlds, 1), peg_of_turn(worlds, 2))["dropped"].all()


def test_the_first_taken_out_and_put_back_last_is_out_of_turn() -> None:
    worlds = started("sort_pegs")
    first, second = peg_of_turn(worlds, 1), peg_of_turn(worlds, 2)
    drop_in(worlds, first, first)
    assert not drop_in(worlds, second, second)["dropped"].any()
    view = worlds.simulation.view
    for k, name in enumerate(PEGS):
        pose, _ = view.free_joint(f"peg_{name}")
        view.qpos[first == k, pose.start + 2] += 0.3
    worlds.set_state(worlds.get_state())
    wait(worlds, 0.04)
    assert view.task_state[np.arange(3), IN + first].tolist() == [0.0, 0.0, 0.0]
    assert drop_in(worlds, first, first)["dropped"].all()


def test_nothing_shows_the_order_once_the_lamps_are_out() -> None:
    """Worlds that differ in the order alone show the same, but for the first two seconds."""
    worlds = started("sort_pegs")
    states = np.repeat(worlds.get_state()[:1], 3, axis=0)
    worlds.set_state(states)
    view = worlds.simulation.view
    lamps = [view.mocap_id(f"lamp_{name}") for name in PEGS]
    places = view.mocap_pos[0, lamps].copy()
    for world, order in enumerate(([0, 1, 2], [1, 2, 0], [2, 1, 0])):
        view.task_state[world, TURN : TURN + 3] = np.array(order) + 1.0
        for k, turn in enumerate(order):
            view.mocap_pos[world, lamps[k]] = places[turn]
    obs, hover = worlds.set_state(worlds.get_state()), hold_actions(worlds)
    for step in range(round(SHOWN_S / worlds.spec.control_dt_s) + 1):
        assert obs["turn"].any() == (step < round(SHOWN_S / worlds.spec.control_dt_s))
        obs = worlds.step(hover).obs
    assert not obs["turn"].any()
    for name, values in obs.items():
        np.testing.assert_array_equal(values[1:], values[:1].repeat(2, axis=0), err_msg=name)
    heights = view.mocap_pos[:, lamps, 2]
    assert (heights + 0.002 < sort_pegs.PANEL_POS[2] + 0.01).all(), "the lamps are within the panel"


def test_a_spoiled_episode_cannot_be_made_good() -> None:
    worlds = started("sort_pegs")
    third = peg_of_turn(worlds, 3)
    drop_in(worlds, third, third)
    for turn in (1, 2):
        peg = peg_of_turn(worlds, turn)
        assert not drop_in(worlds, peg, peg)["success"].any()
    assert worlds.simulation.view.task_state[:, SPOILED].all()


# cabinet_retrieve


def on_spot(worlds: BatchEnvironment) -> np.ndarray:
    return worlds.simulation.view.site_pos("spot") + np.array([0.0, 0.0, CUBE_HALF_M])


def test_a_cube_set_down_by_hand_counts_after_a_second() -> None:
    worlds = started("cabinet_retrieve")
    put(worlds, "cube", on_spot(worlds))
    assert not wait(worlds, 0.9)["success"].any()
    assert wait(worlds, 0.3)["success"].all()
    put(worlds, "cube", on_spot(worlds) + np.array([0.02, 0.0, 0.0]))
    assert not wait(worlds, 1.2)["success"].any()


def test_a_cube_on_its_side_does_not_count() -> None:
    worlds = started("cabinet_retrieve")
    put(worlds, "cube", on_spot(worlds), ON_ITS_SIDE)
    assert not wait(worlds, 1.5)["success"].any()


def test_a_cube_pushed_over_the_spot_does_not_count() -> None:
    worlds = started("cabinet_retrieve")
    put(worlds, "cube", on_spot(worlds) - np.array([0.05, 0.0, 0.0]))
    _, speed = worlds.simulation.view.free_joint("cube")
    worlds.simulation.view.qvel[:, speed.start] = [1.0, 1.5, 2.0]
    worlds.set_state(worlds.get_state())
    assert not wait(worlds, 2.0)["success"].any()


@pytest.mark.parametrize("robot", ["fa_hexa_arm4", "big_four_z1"])
def test_no_gripper_gets_through_the_closed_door_from_above(robot: str) -> None:
    worlds = batch(robot, "cabinet_retrieve")
    worlds.reset(30)
    view = worlds.simulation.view
    before, hover = view.site_pos("cube").copy(), hold_actions(worlds)
    hover[:, -1] = 0.0
    for height in (*np.full(150, 0.3), *np.linspace(0.3, 0.0, 100), *np.full(50, 0.0)):
        hover[:, :3] = before + np.array([0.0, 0.0, height])
        worlds.step(hover)
    assert (view.tip_pos[:, 2] > TABLE_HEIGHT_M + HOOD_M).all(), "it stands on the grille"
    assert np.linalg.norm(view.site_pos("cube") - before, axis=1).max() < 1e-3


def test_the_expert_opens_the_door_again_that_has_fallen_shut() -> None:
    worlds, expert = batch(ROBOT, "cabinet_retrieve"), aerial_il.expert(ROBOT, "cabinet_retrieve")
    expert.attach(worlds)
    worlds.reset(30)
    expert.reset()
    view = worlds.simulation.view
    while (view.joint("door")[0] < OPEN_ENOUGH_RAD).any() or (view.tip_pos[:, 2] < TABLE_HEIGHT_M + WALL_M).any():
        worlds.step(expert.act({}))
    view.joint("door")[0][:] = 0.3
    worlds.set_state(worlds.get_state())
    expert.act({})
    assert (expert.phase < len(cabinet_expert_phases("open"))).all(), "it noticed"
    assert fly_until_solved(worlds, expert).all()


def cabinet_expert_phases(stage: str) -> list[str]:
    names = type(aerial_il.expert(ROBOT, "cabinet_retrieve")).phase_names
    return [name for name in names if name.startswith(stage)]


# restock


def stow(worlds: BatchEnvironment, count: int = 3) -> None:
    """Lay cubes side by side in the cabinet."""
    view = worlds.simulation.view
    mat, hinge = view.site_mat("door"), view.site_pos("door")
    for k, name in enumerate(tuple(restock.COLOURS)[:count]):
        aside = 0.09 * (k - 1) - cabinet_retrieve.HINGE_ASIDE_M
        pos = hinge - 0.075 * mat[:, [0, 3, 6]] + aside * mat[:, [1, 4, 7]]
        pos[:, 2] = TABLE_HEIGHT_M + restock.FLOOR_M + CUBE_HALF_M
        put(worlds, f"cube_{name}", pos)


def swing(worlds: BatchEnvironment, angle: float, rate: float = 0.0) -> None:
    position, speed = worlds.simulation.view.joint("door")
    position[:], speed[:] = angle, rate
    worlds.set_state(worlds.get_state())


def test_cubes_count_behind_a_shut_door_only() -> None:
    worlds = started("restock")
    stow(worlds)
    swing(worlds, np.deg2rad(8.0))
    assert not wait(worlds, 1.5)["success"].any()
    swing(worlds, np.deg2rad(3.0))
    assert not wait(worlds, 0.9)["success"].any()
    assert wait(worlds, 0.3)["success"].all()


def test_two_cubes_in_and_one_on_top_do_not_count() -> None:
    worlds = started("restock")
    stow(worlds, 2)
    swing(worlds, 0.0)
    view = worlds.simulation.view
    top = view.site_pos("cube_yellow") * [1.0, 1.0, 0.0] + [0.0, 0.0, TABLE_HEIGHT_M + HOOD_M + 0.03]
    put(worlds, "cube_purple", top)
    assert not wait(worlds, 1.5)["success"].any()
    assert (view.site_pos("cube_purple")[:, 2] > TABLE_HEIGHT_M + HOOD_M).all(), "it lies on the door's top"


def test_a_robot_that_leans_on_the_shut_door_does_not_count() -> None:
    worlds = batch(ROBOT, "restock")
    worlds.reset(30)
    stow(worlds)
    swing(worlds, 0.0)
    view = worlds.simulation.view
    over, hover = view.site_pos("cube_yellow").copy(), hold_actions(worlds)
    solved = np.zeros(3, bool)
    for step, height in enumerate((*np.full(150, 0.3), *np.linspace(0.3, 0.05, 100), *np.full(80, 0.05))):
        hover[:, :3], hover[:, -1] = over + np.array([0.0, 0.0, height]), 0.0
        result = worlds.step(hover)
        solved |= result.info["success"] & (step > 250)
    assert not solved.any()


def test_a_door_slammed_on_a_cube_neither_cuts_nor_throws_it() -> None:
    worlds = started("restock")
    stow(worlds)
    view = worlds.simulation.view
    in_the_way = view.site_pos("cube_yellow") + 0.07 * view.site_mat("door")[:, [0, 3, 6]]
    put(worlds, "cube_yellow", in_the_way)
    swing(worlds, 1.2, rate=-6.0)
    hover, fastest, deepest = hold_actions(worlds), 0.0, 0.0
    for _ in range(100):
        worlds.step(hover)
        _, speed = view.free_joint("cube_yellow")
        fastest = max(fastest, np.linalg.norm(view.qvel[:, speed.start : speed.start + 3], axis=1).max())
        for i in range(3):
            data = worlds.simulation.worlds.data(i)
            deepest = max([deepest, *(-data.contact.dist[: data.ncon])])
    assert fastest < 6.0 * 0.36, "no faster than the door's edge"
    assert deepest < 0.004
    assert np.isfinite(view.qpos).all()


def test_stands_and_holes_leave_room_between_them() -> None:
    worlds = batch(ROBOT, "sort_pegs", num_envs=16)
    worlds.reset(0)
    view = worlds.simulation.view
    places = np.stack([view.site_pos(f"{what}_{name}") for what in ("hole", "stand") for name in PEGS], axis=1)
    gaps = np.linalg.norm(places[:, :, None, :2] - places[:, None, :, :2], axis=3) + np.eye(6)
    assert gaps.min() >= sort_pegs.APART_M - 1e-9
    assert (np.abs(places[..., 1]) <= AREA_HIGH[1]).all()
