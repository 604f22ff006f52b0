"""Environments from outside keep the batch's promises: seeds decide, worlds are independent, masks are kept."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from typing import Any

import gymnasium
import numpy as np
import pytest
from dm_control import suite
from dm_control.suite.wrappers import action_scale
from gymnasium import spaces

import aerial_il
from aerial_il.core.errors import InvalidValueError, SimulationDivergedError, UnknownNameError
from aerial_il.core.specs import EnvSpec
from aerial_il.evaluation.baselines import Random
from aerial_il.evaluation.rollouts import evaluate, rollouts
from aerial_il.suite import outside
from aerial_il.suite.outside.batch import OutsideBatch
from aerial_il.suite.outside.gymnasium_world import action_spec, named_observation, observation_spec
from aerial_il.suite.outside.success import SuccessRule


def pendulum(n: int, **options: Any) -> OutsideBatch:
    return aerial_il.load_gymnasium("Pendulum-v1", num_envs=n, max_steps=20, **options)


def cart(n: int, **options: Any) -> OutsideBatch:
    return aerial_il.load_gymnasium("CartPole-v1", num_envs=n, max_steps=60, **options)


def hopper(n: int, **options: Any) -> OutsideBatch:
    return aerial_il.load_gymnasium("Hopper-v5", num_envs=n, max_steps=30, **options)


def swinging(n: int, **options: Any) -> OutsideBatch:
    return outside.load_dm_control("cartpole-balance", num_envs=n, max_steps=20, **options)


ALL = [pendulum, cart, hopper, swinging]
Make = Callable[..., OutsideBatch]


def actions_of(env: OutsideBatch, steps: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.uniform(env.spec.action.low, env.spec.action.high, (steps, env.num_envs, env.spec.action.size))


def fly(env: OutsideBatch, seeds: Any, actions: np.ndarray) -> list[Any]:
    """Return observations and rewards of worlds that never stop."""
    shown: list[Any] = [env.reset(seeds)]
    for action in actions:
        result = env.step(action)
        shown += [result.obs, result.reward]
    return shown


def same(a: list[Any], b: list[Any], world_a: int, world_b: int) -> bool:
    def rows(item: Any, world: int) -> list[np.ndarray]:
        return [v[world] for v in item.values()] if isinstance(item, dict) else [item[world]]

    pairs = zip(a, b, strict=True)
    return all(np.array_equal(x, y) for p, q in pairs for x, y in zip(rows(p, world_a), rows(q, world_b), strict=True))


@pytest.mark.parametrize("make", ALL)
def test_what_is_shown_and_taken_is_what_the_specification_says(make: Make) -> None:
    env = make(3)
    obs = env.reset(5)
    result = env.step(actions_of(env, 1)[0])
    for field in env.spec.observation.fields:
        assert obs[field.name].shape == result.obs[field.name].shape == (3, *field.shape)
        assert obs[field.name].dtype == np.dtype(field.dtype)
    assert EnvSpec.from_dict(env.spec.to_dict()).differences(env.spec, ignore=()) == []
    assert env.spec.is_outside
    assert env.get_state().shape == (3, env.spec.state_size)
    assert env.ctrl.shape == (3, env.model.nu)
    assert set(result.info) >= {"success", "crash", "executed_action", "ee_error_m", "effort", "contacts", "subtasks"}
    np.testing.assert_allclose(env.sim_time, env.spec.control_dt_s)


@pytest.mark.parametrize("make", ALL)
def test_a_seed_decides_an_episode(make: Make) -> None:
    one, many = make(1), make(3)
    actions = actions_of(many, 8)
    fly(many, [9, 9, 9], actions_of(many, 8, seed=1))
    together = fly(many, [4, 5, 6], actions)
    for world, seed in enumerate((4, 5, 6)):
        alone = fly(one, [seed], actions[:, world : world + 1])
        assert same(alone, together, 0, world)
    assert not same(together, together, 0, 1)


@pytest.mark.parametrize("make", ALL)
def test_a_world_outside_the_mask_stands_still(make: Make) -> None:
    env = make(2)
    before = env.reset(3)
    state = env.get_state()
    result = env.step(actions_of(env, 1)[0], np.array([True, False]))
    for name, values in before.items():
        assert np.array_equal(result.obs[name][1], values[1])
    assert not np.array_equal(result.obs[env.spec.observation.names[0]][0], before[env.spec.observation.names[0]][0])
    assert np.array_equal(env.get_state()[1], state[1])
    assert env.sim_time[1] == 0
    after = env.reset([7, 8], np.array([False, True]))
    assert env.seeds.tolist() == [3, 8]
    assert np.array_equal(after[env.spec.observation.names[0]][0], result.obs[env.spec.observation.names[0]][0])


@pytest.mark.parametrize("make", [hopper, swinging])
def test_a_recorded_state_continues_bit_for_bit(make: Make) -> None:
    env = make(2)
    env.reset(1)
    actions = actions_of(env, 6)
    for action in actions[:3]:
        env.step(action)
    state = env.get_state()
    first = [env.step(action) for action in actions[3:]]
    shown = env.set_state(state)
    assert all(np.isfinite(values).all() for values in shown.values())
    again = [env.step(action) for action in actions[3:]]
    for a, b in zip(first, again, strict=True):
        assert all(np.array_equal(a.obs[name], b.obs[name]) for name in a.obs)
        assert np.array_equal(a.reward, b.reward)


def test_the_whole_horizon_is_flown_unless_asked() -> None:
    whole = list(rollouts(cart(2, success="return:5"), Random(), [0, 1]))
    ended = list(rollouts(cart(2, success="return:5", ends_at_success=True), Random(), [0, 1]))
    assert all(len(trace) > 5 for trace in whole)
    assert all(len(trace) == 5 and trace.success for trace in ended)


def test_the_number_of_worlds_changes_no_evaluation() -> None:
    one, many = (evaluate(pendulum(n), Random(), range(6), policy_name="r", progress=False) for n in (1, 4))
    assert one.episodes == many.episodes
    assert one.episodes[0].return_ < -1
    assert one.metrics["ends"] == {"success": 6, "crash": 0, "dropped": 0, "timeout": 0}, (
        "nothing reported: surviving is success"
    )


def test_falling_is_a_crash_and_time_out_is_none() -> None:
    env = aerial_il.load_gymnasium("CartPole-v1", num_envs=1, max_steps=200)
    (fallen,) = rollouts(env, Random(), [0])
    assert fallen.crash
    assert not fallen.success
    (lasting,) = rollouts(pendulum(1), Random(), [0])
    assert not lasting.crash
    assert len(lasting) == 20


def test_a_choice_among_actions_is_the_highest_score() -> None:
    env = cart(1)
    env.reset(0)
    assert env.step(np.array([[0.2, 0.7]])).info["executed_action"].tolist() == [[0.0, 1.0]]


def test_dictionaries_and_choices_become_named_fields() -> None:
    space = spaces.Dict(
        observation=spaces.Box(-1, 1, (2, 2)),
        desired_goal=spaces.Box(-1, 1, (3,)),
        rung=spaces.Discrete(4),
        camera=spaces.Box(0, 255, (8, 8, 3), np.uint8),
    )
    spec = observation_spec(space)
    assert {f.name: (f.shape, f.group) for f in spec.fields} == {
        "observation": ((2, 2), "proprio"),
        "desired_goal": ((3,), "task"),
        "rung": ((4,), "proprio"),
        "camera": ((8, 8, 3), "image"),
    }
    shown = named_observation(space, {**space.sample(), "rung": 2})
    assert shown["rung"].tolist() == [0, 0, 1, 0]
    assert shown["camera"].dtype == np.uint8


@pytest.mark.parametrize("space", [spaces.Box(-np.inf, np.inf, (2,)), spaces.MultiDiscrete([2, 3])])
def test_actions_without_bounds_or_of_another_kind_are_refused(space: Any) -> None:
    with pytest.raises(InvalidValueError, match="finite bounds"):
        action_spec(space)


@pytest.mark.parametrize(
    ("rule", "count", "total", "survived", "holds"),
    [
        ("success:25", 25, 0, True, False),
        ("success:25", 26, 0, False, True),
        ("return:-3.5", 0, -3.5, False, True),
        ("return:10", 0, 9.9, True, False),
        ("survived", 0, 0, True, True),
        ("survived", 9, 9, False, False),
    ],
)
def test_success_is_what_the_rule_says(rule: str, count: int, total: float, survived: bool, holds: bool) -> None:
    assert SuccessRule.of(rule).holds(count=count, total_reward=total, survived=survived) is holds


def test_what_cannot_be_made_is_explained() -> None:
    with pytest.raises(InvalidValueError, match="NoSuch"):
        aerial_il.load_gymnasium("NoSuch-v0")
    with pytest.raises(UnknownNameError, match="cartpole-balance"):
        outside.load("dm_control:cartpole-balanc")
    with pytest.raises(UnknownNameError, match="gymnasium"):
        outside.load("gymnasiun:Pendulum-v1")
    with pytest.raises(InvalidValueError, match="env=gymnasium"):
        outside.load("Pendulum-v1")
    with pytest.raises(InvalidValueError, match="is no rule"):
        pendulum(1, success="often")


@pytest.mark.parametrize("spoilt", ["reward", "observation"])
def test_what_is_not_finite_is_refused_by_seed_and_step(spoilt: str) -> None:
    class Broken(gymnasium.Env[np.ndarray, np.ndarray]):
        observation_space, action_space = spaces.Box(-1, 1, (1,)), spaces.Box(-1, 1, (1,))

        def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
            return np.zeros(1, np.float32), {}

        def step(self, action: np.ndarray) -> Any:
            value = np.nan if action[0] > 0.5 else 0.0
            shown, paid = (value, 0.0) if spoilt == "observation" else (0.0, value)
            return np.full(1, shown, np.float32), paid, False, False, {}

    gymnasium.register(f"Broken{spoilt}-v0", entry_point=lambda: Broken(), max_episode_steps=5)
    env = aerial_il.load_gymnasium(f"Broken{spoilt}-v0", num_envs=2)
    env.reset(11)
    env.step(np.zeros((2, 1)))
    with pytest.raises(SimulationDivergedError, match=f"(?i){spoilt}.* of Broken{spoilt}-v0 .* step 2 .* seed 12"):
        env.step(np.array([[0.0], [1.0]]))


def test_a_specification_names_its_environment() -> None:
    env = outside.load("gymnasium:Pendulum-v1", num_envs=1, max_steps=7, success="return:-50")
    spec = EnvSpec.from_dict(env.spec.to_dict())
    again = outside.load(str(outside.key_of(spec)), num_envs=2, **outside.checked_options(spec))
    assert again.num_envs == 2
    assert again.spec == env.spec


def test_a_dm_env_of_ones_own_is_flown() -> None:
    from dm_control import suite

    def make(seed: int) -> Any:
        return suite.load("pendulum", "swingup", task_kwargs={"random": seed})

    env = aerial_il.load_dm_env(make, num_envs=2, name="pendulum", max_steps=5)
    result = evaluate(env, Random(), range(3), policy_name="random", progress=False)
    assert (result.robot, result.task) == ("dm_env", "pendulum")
    assert [e.steps for e in result.episodes] == [5, 5, 5]
    assert outside.key_of(env.spec) is None, "only who made it can make it again"


class Pictured(gymnasium.Env[Any, Any]):
    """Shows pictures of a shape."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.observation_space, self.action_space = spaces.Box(0, 255, shape, np.uint8), spaces.Discrete(2)


@pytest.mark.parametrize("shape", [(84, 84, 1), (84, 84, 4), (3, 84, 84), (6, 7, 2)])
def test_what_is_no_picture_in_colours_is_numbers(shape: tuple[int, ...]) -> None:
    """Stacks of frames, channels first, boards: they are flown, and recorded as what they are."""
    space = Pictured(shape).observation_space
    (field,) = observation_spec(space).fields
    assert (field.group, field.dtype, field.shape) == ("proprio", "float64", shape)
    assert named_observation(space, np.ones(shape, np.uint8))["observation"].dtype == float
    assert observation_spec(Pictured((84, 84, 3)).observation_space).fields[0].group == "image"


def test_a_longer_time_limit_than_its_own_is_flown() -> None:
    def wrapped(seed: int) -> Any:
        return action_scale.Wrapper(suite.load("cartpole", "balance", {"random": seed}), -1.0, 1.0)

    bare = outside.load_dm_control("cartpole-balance", num_envs=1, max_steps=1003)
    for made in (bare, outside.load_dm_env(wrapped, num_envs=1, max_steps=1003)):
        with closing(made) as env:
            env.reset(0)
            ends = [bool(env.step(np.zeros((1, 1))).truncated[0]) for _ in range(1003)]
        assert ends == [False] * 1002 + [True]
    for wrong in (0, -1, 2.5):
        with pytest.raises(InvalidValueError, match=f"max_steps is {wrong}; it must be an integer, at least 1"):
            outside.load_dm_control("cartpole-balance", num_envs=1, max_steps=wrong)


def test_an_environment_without_a_version_is_the_newest() -> None:
    with closing(aerial_il.load_gymnasium("CartPole", num_envs=1)) as env:
        assert env.spec.max_steps == 500


def test_an_episode_answers_nothing_of_the_one_before() -> None:
    with closing(cart(2)) as env:
        env.reset(0)
        told = [env.step(np.tile([1.0, 0.0], (2, 1))) for _ in range(30)]
        lost = told[-1].terminated
        assert lost.any(), "it falls"
        env.reset(5, np.array([True, False]))
        again = env.step(np.tile([1.0, 0.0], (2, 1)), np.array([False, True]))
        assert (again.terminated[0], again.reward[0], again.info["success"][0]) == (False, 0.0, False)
        assert told[-1].terminated is lost
        assert told[-1].terminated[0], "what was told stays as it was told"
