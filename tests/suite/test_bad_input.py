"""What is wrong is refused by name, with the choices; what diverges names seed and step."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import aerial_il
from aerial_il.core.errors import AerialError, InvalidValueError, SimulationDivergedError, UnknownNameError
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.environment import AerialEnvironment
from tests.contract.registered import batch, hold_actions, single

CELL = ("ua_quad_arm4", "reach")


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        (("ua_quad_arm", "reach"), {}, "Unknown robot 'ua_quad_arm'. Did you mean 'ua_quad_arm4'"),
        (("ua_quad_arm4", "pickplace"), {}, "Unknown task 'pickplace'. Did you mean 'pick_place'"),
        (CELL, {"tier": "calm+wnd"}, "Unknown tier component 'wnd'. Did you mean 'wind'"),
        (CELL, {"tier": "gust"}, "Unknown tier 'gust'. Did you mean 'gusts'"),
        (CELL, {"action": "ee"}, "Unknown action level 'ee'."),
        (CELL, {"controller": "piid"}, "Unknown controller 'piid'. Did you mean 'pid'"),
        (CELL, {"cameras": ("wirst",)}, "Unknown camera 'wirst'. Did you mean 'wrist'"),
        (CELL, {"cameras": ("wrist:rbg",)}, "Unknown image modality 'rbg'. Did you mean 'rgb'"),
    ],
)
def test_unknown_names_are_answered_with_the_nearest(arguments: tuple, options: dict, message: str) -> None:
    for load in (aerial_il.load, aerial_il.load_batch):
        with pytest.raises(UnknownNameError) as caught:
            load(*arguments, **options)
        assert str(caught.value).startswith(message)
        assert "Valid: " in str(caught.value)


def test_impossible_requests_are_refused() -> None:
    twice, too_small, too_large = {"cameras": ("wrist", "wrist")}, {"image_size": (0, 10)}, {"image_size": (9999, 1)}
    no_pair = [{"image_size": size} for size in ((10,), 64, (64.5, 64), "64")]
    for options in ({"cameras": "wrist"}, twice, too_small, too_large, *no_pair):
        with pytest.raises(InvalidValueError):
            aerial_il.load(*CELL, **options)
    for name, value in (("num_envs", 0), ("num_envs", 4.5), ("num_threads", -1), ("num_threads", 1.0)):
        with pytest.raises(InvalidValueError, match=f"{name} is {value}; it must be an integer, at least"):
            aerial_il.load_batch(*CELL, **{name: value})


@pytest.mark.parametrize("seed", [-1, 2**53])
def test_seeds_outside_their_range_are_refused(seed: int) -> None:
    with pytest.raises(InvalidValueError, match=f"0 to 2\\*\\*53 - 1, got {seed}"):
        single(*CELL).reset(seed=seed)
    with pytest.raises(InvalidValueError, match="0 to 2"):
        batch(*CELL).reset(np.array([0, seed, 1]))


@pytest.mark.parametrize("seeds", [np.nan, 1.7, [0.4, 1.9, 2.0], [True, False, True], "1"])
def test_seeds_that_are_no_integers_are_refused(seeds: Any) -> None:
    with pytest.raises(InvalidValueError, match="seeds are integers from 0"):
        batch(*CELL).reset(seeds)


def test_wrong_shapes_are_refused_with_the_right_ones() -> None:
    worlds, env = batch(*CELL), single(*CELL)
    worlds.reset(0)
    env.reset(seed=0)
    with pytest.raises(InvalidValueError, match=r"takes actions of shape \(3, 10\) \(ee_x, ee_y"):
        worlds.step(np.zeros((2, 10)))
    with pytest.raises(InvalidValueError, match=r"shape \(1, 10\)"):
        env.step(np.zeros(9))
    with pytest.raises(InvalidValueError, match="one entry per world"):
        worlds.reset(np.array([1, 2]))
    with pytest.raises(InvalidValueError, match="mask has one bool per world"):
        worlds.step(np.zeros((3, 10)), np.array([True]))
    with pytest.raises(InvalidValueError, match=r"mask has one bool per world, \(3,\), got array\(\[0, 1, 2\]\)"):
        worlds.step(np.zeros((3, 10)), np.array([0, 1, 2]))
    with pytest.raises(InvalidValueError, match="States have shape"):
        worlds.set_state(np.zeros((3, 7)))
    with pytest.raises(InvalidValueError, match="States have shape"):
        env.set_state(np.zeros((1, 7)))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_an_action_that_is_not_finite_names_seed_and_step(value: float) -> None:
    worlds, env = batch(*CELL), single(*CELL)
    worlds.reset(30)
    env.reset(seed=31)
    action = np.tile(worlds.spec.action.high, (3, 1))
    for _ in range(4):
        worlds.step(action)
        env.step(action[1])
    action[1, 2] = value
    for step in (lambda: worlds.step(action), lambda: env.step(action[1])):
        with pytest.raises(SimulationDivergedError, match=r"Action is not finite at step 4 .* seed 31") as caught:
            step()
        assert (caught.value.seed, caught.value.step) == (31, 4)


def flown_to_step_3() -> tuple[BatchEnvironment, AerialEnvironment, np.ndarray]:
    """A batch whose world 1, and a single world, that have flown three steps of seed 31; and actions for them."""
    worlds, env = batch(*CELL), single(*CELL)
    worlds.reset(30)
    env.reset(seed=31)
    hover = hold_actions(worlds)
    for _ in range(3):
        worlds.step(hover)
        env.step(hover[1])
    return worlds, env, hover


@pytest.mark.parametrize(("field", "value"), [("qvel", np.nan), ("qvel", 1e12), ("qpos", np.inf), ("qpos", -1e11)])
def test_physics_that_blows_up_names_seed_and_step(field: str, value: float) -> None:
    """MuJoCo itself only warns, and resets the world to its defaults."""
    worlds, env, hover = flown_to_step_3()
    worlds.simulation.worlds.bind(field)[1, 0] = value
    env.simulation.worlds.bind(field)[0, 0] = value
    for step in (lambda: worlds.step(hover), lambda: env.step(hover[1])):
        with pytest.raises(SimulationDivergedError) as caught:
            step()
        assert (caught.value.seed, caught.value.step) == (31, 3)


@pytest.mark.parametrize(("field", "value"), [("qvel", np.nan), ("qvel", 1e12), ("qpos", np.nan), ("userdata", np.inf)])
def test_a_state_that_is_not_sound_is_refused(field: str, value: float) -> None:
    worlds, env, hover = flown_to_step_3()
    sound = worlds.get_state()
    worlds.simulation.worlds.bind(field)[1, 0] = value
    broken = worlds.get_state()
    for continue_from in (lambda: worlds.set_state(broken), lambda: env.set_state(broken[1:2])):
        with pytest.raises(SimulationDivergedError) as caught:
            continue_from()
        assert (caught.value.seed, caught.value.step) == (31, 3)
    worlds.set_state(sound)  # and a sound one flies on
    env.set_state(sound[1:2])
    worlds.step(hover)
    env.step(hover[1])
    np.testing.assert_array_equal(worlds.get_state()[1], env.get_state()[0])


def test_a_broken_world_outside_the_mask_disturbs_no_other() -> None:
    worlds, _, hover = flown_to_step_3()
    worlds.simulation.worlds.bind("qvel")[1, 0] = np.nan
    with pytest.raises(SimulationDivergedError):
        worlds.step(hover)
    worlds.step(hover, np.array([True, False, True]))
    worlds.reset(np.array([0, 77, 0]), np.array([False, True, False]))
    worlds.step(hover)
    assert worlds.simulation.steps.tolist() == [6, 1, 6]  # the sound worlds have flown all steps, the failed one too


def test_one_except_catches_them_all() -> None:
    for wrong in (UnknownNameError, InvalidValueError, SimulationDivergedError):
        assert issubclass(wrong, AerialError)
