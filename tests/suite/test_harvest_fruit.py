"""A stem holds until 6 N and breaks for good; a ripe fruit counts in the basket, an unripe one spoils the harvest."""

from __future__ import annotations

import numpy as np
import pytest

import aerial_il
from aerial_il.experts.set_down import RELEASE
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.props.fruit import FRUIT_M, STEM_M, STEM_N, STIFFNESS
from aerial_il.suite.props.table import TABLE_HEIGHT_M
from aerial_il.suite.tasks.harvest_fruit import FRUITS
from tests.contract.registered import batch, fly_until_solved
from tests.suite.test_long_tasks import ROBOT, put, started, wait

TASK = "harvest_fruit"
RIPE, UNRIPE = slice(0, 2), slice(2, 4)


def cut(worlds: BatchEnvironment, name: str) -> None:
    """Break a stem by hand, without a pull."""
    simulation = worlds.simulation
    simulation.view.task_state[:, FRUITS.index(name)] = 1.0
    simulation.worlds.bind("ctrl")[:, simulation.worlds.model.actuator(f"stem_{name}").id] = 0.0


def in_basket(worlds: BatchEnvironment, name: str) -> None:
    cut(worlds, name)
    put(worlds, name, worlds.simulation.view.site_pos("basket") + np.array([0.01, 0.0, 0.032]))


def pulled(worlds: BatchEnvironment, name: str, newtons: float, seconds: float) -> bool:
    """Pull a fruit up with a force, beyond its weight, that grows for half a second; return whether all are lost."""
    simulation = worlds.simulation
    model = simulation.worlds.model
    push = simulation.worlds.bind("xfrc_applied").reshape(3, model.nbody, 6)[:, model.body(name).id]
    dropped = np.zeros(3, bool)
    for share in np.linspace(0.0, 1.0, 25):
        push[:, 2] = share * newtons + 9.81 * model.body(name).mass[0]
        dropped |= wait(worlds, 0.02)["dropped"]
    dropped |= wait(worlds, seconds)["dropped"]
    push[:] = 0.0
    return bool(dropped.all())


def broken(worlds: BatchEnvironment) -> np.ndarray:
    """(n, 4) bool: whose stems are broken."""
    return worlds.simulation.view.task_state[:, :4] > 0.0


def test_a_stem_holds_until_six_newtons() -> None:
    worlds = started(TASK)
    pulled(worlds, "ripe_a", 0.9 * STEM_N, 1.0)
    assert not broken(worlds).any()
    wait(worlds, 1.5)
    height = worlds.simulation.view.site_pos("ripe_a")[:, 2]
    np.testing.assert_allclose(height, TABLE_HEIGHT_M + FRUIT_M, atol=1e-3, err_msg="not in its calyx")
    pulled(worlds, "ripe_a", 1.2 * STEM_N, 0.3)
    assert broken(worlds)[:, 0].all()
    assert not broken(worlds)[:, 1:].any()


def test_it_gives_as_much_as_its_stiffness_says() -> None:
    worlds = started(TASK)
    simulation = worlds.simulation
    address = simulation.worlds.model.sensor("stem_ripe_b").adr[0]
    newtons = 0.4 * STEM_N
    pulled(worlds, "ripe_b", newtons, 1.5)
    length = simulation.worlds.bind("sensordata")[:, address]
    np.testing.assert_allclose(length - STEM_M, newtons / STIFFNESS, rtol=0.1)


def test_a_broken_stem_does_not_heal() -> None:
    worlds = started(TASK)
    in_basket(worlds, "ripe_a")
    wait(worlds, 0.04)
    pos = worlds.simulation.view.mocap_pos[:, worlds.simulation.view.mocap_id("plant_ripe_a")].copy()
    put(worlds, "ripe_a", pos + np.array([0.0, 0.0, FRUIT_M]))
    assert not wait(worlds, 1.0)["success"].any()
    assert broken(worlds)[:, 0].all()
    pulled(worlds, "ripe_a", 0.5, 0.2)
    assert (worlds.simulation.view.site_pos("ripe_a")[:, 2] > TABLE_HEIGHT_M + FRUIT_M + 0.05).all(), "nothing holds it"


@pytest.mark.parametrize("name", ["ripe_a", "ripe_b"])
def test_either_ripe_fruit_counts_after_half_a_second(name: str) -> None:
    worlds = started(TASK)
    in_basket(worlds, name)
    assert not wait(worlds, 0.4)["success"].any()
    assert wait(worlds, 1.0)["success"].all()


def test_an_unripe_fruit_torn_off_spoils_the_harvest() -> None:
    worlds = started(TASK)
    in_basket(worlds, "ripe_a")
    assert wait(worlds, 1.4)["success"].all()
    assert pulled(worlds, "unripe_b", 1.2 * STEM_N, 0.3)
    wait(worlds, 1.0)
    assert not worlds.simulation.reassess().success.any()


def test_an_unripe_fruit_in_the_basket_is_no_harvest() -> None:
    worlds = started(TASK)
    in_basket(worlds, "unripe_a")
    ever = wait(worlds, 1.4)
    assert ever["dropped"].all()
    assert not ever["success"].any()


def test_a_fruit_that_flies_over_the_basket_does_not_count() -> None:
    worlds = started(TASK)
    view = worlds.simulation.view
    cut(worlds, "ripe_a")
    put(worlds, "ripe_a", view.site_pos("basket") + np.array([-0.05, 0.0, 0.10]))
    _, speed = view.free_joint("ripe_a")
    view.qvel[:, speed.start] = 2.0
    worlds.set_state(worlds.get_state())
    assert not wait(worlds, 1.5)["success"].any()


def test_a_fruit_held_in_the_basket_does_not_count() -> None:
    worlds, expert = batch(ROBOT, TASK), aerial_il.expert(ROBOT, TASK)
    worlds.reset(30)
    expert.attach(worlds)
    expert.reset()
    action, solved, arrived = expert.act({}), np.zeros(3, bool), np.zeros(3, bool)
    for _ in range(400):
        new = expert.act({})
        landing = (expert.phase == RELEASE) & ~arrived
        arrived |= landing
        action = np.where(arrived[:, None], action, new)  # go on down, the gripper closed
        action[landing, 2] -= 0.02
        solved |= worlds.step(action).info["success"]
    assert arrived.all()
    assert not solved.any()


def test_one_ripe_fruit_may_be_lost_but_not_both() -> None:
    worlds, floor = started(TASK), np.array([[0.7, 0.0, 0.03]])
    for name in FRUITS[:2]:
        cut(worlds, name)
    put(worlds, "ripe_a", np.tile(floor, (3, 1)))
    assert not wait(worlds, 0.3)["dropped"].any()
    put(worlds, "ripe_b", np.tile(-floor * [1, 1, -1], (3, 1)))
    assert wait(worlds, 0.1)["dropped"].all()


def test_the_expert_takes_the_other_one_when_one_is_lost() -> None:
    worlds, expert = batch(ROBOT, TASK), aerial_il.expert(ROBOT, TASK)
    worlds.reset(30)
    expert.attach(worlds)
    expert.reset()
    cut(worlds, "ripe_b")
    put(worlds, "ripe_b", np.tile([0.7, 0.0, 0.03], (3, 1)))
    assert fly_until_solved(worlds, expert).all()


def test_a_state_restored_breaks_the_stem_in_the_same_step() -> None:
    worlds, expert = batch(ROBOT, TASK), aerial_il.expert(ROBOT, TASK)
    worlds.reset(30)
    expert.attach(worlds)
    expert.reset()
    while not (expert.phase >= 3).any():  # a stem is being pulled
        worlds.step(expert.act({}))
    start, actions, states = worlds.get_state(), [], []
    for _ in range(60):
        actions.append(expert.act({}))
        worlds.step(actions[-1])
        states.append(worlds.get_state())
    assert broken(worlds)[:, RIPE].any()
    assert not broken(worlds)[:, UNRIPE].any()
    other = aerial_il.load_batch(ROBOT, TASK, num_envs=3, num_threads=1)
    other.reset(77)
    other.set_state(start)
    for action, state in zip(actions, states, strict=True):
        other.step(action)
        np.testing.assert_array_equal(other.get_state(), state)
    other.close()


def test_leaves_give_way_and_come_back() -> None:
    worlds = started(TASK)
    view, name = worlds.simulation.view, "leaf_ripe_a"
    angle, rate = view.joint(name)
    before = angle.copy()
    angle[:], rate[:] = 1.0, 0.0
    worlds.set_state(worlds.get_state())
    wait(worlds, 1.0)
    np.testing.assert_allclose(view.joint(name)[0], before, atol=0.02)
    assert not broken(worlds).any(), "a leaf that snaps back tears nothing off"
