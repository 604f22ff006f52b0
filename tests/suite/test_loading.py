"""What is chosen where an environment is loaded: tier, flight law, and a batch called without arguments."""

from __future__ import annotations

import dataclasses
import json

import gymnasium
import numpy as np
import pytest

import aerial_il
from aerial_il.control import controller_state as layout
from aerial_il.core import registry
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.specs import EnvSpec
from aerial_il.suite import disturbances, tiers
from aerial_il.suite.physics.thread_pool import CORES, ThreadPool, available_cores
from tests.contract.registered import random_actions

IN_HARD = tuple(name for name in tiers.components() if "hard" in disturbances.strengths(name))


def test_the_tiers_grow_rougher() -> None:
    assert tiers.names() == ("calm", "breeze", "gusts", "hard")
    assert [tiers.get(name).name for name in tiers.names()] == list(tiers.names())
    assert tiers.get("calm").components == ("noise",)
    assert tiers.get("breeze").components == ("wind", "noise")
    assert tiers.get("gusts").components == ("wind", "noise", "estimation")
    assert tiers.get("hard").components == IN_HARD
    shares = [tiers.get(name).to_dict()["wind"]["share"] for name in ("breeze", "gusts", "hard")]
    assert shares == [0.06, 0.13, 0.13]


@pytest.mark.parametrize("component", IN_HARD)
def test_each_component_can_stand_alone_and_be_left_out(component: str) -> None:
    hard, alone = tiers.get("hard"), tiers.get(f"calm+{component}")
    assert alone.parts[component] == hard.parts[component]
    assert set(alone.components) == {"noise", component}
    without = tiers.get(f"hard-{component}")
    assert component not in without.parts
    assert dataclasses.replace(without.with_part(component, hard.parts[component]), name="hard") == hard


def test_names_are_canonical() -> None:
    assert tiers.get("calm+friction+wind").name == tiers.get("calm+wind+friction").name == "calm+wind+friction"
    assert tiers.get("hard-noise-wind").name == "hard-wind-noise"
    assert tiers.get("gusts+latency-noise").name == tiers.get("gusts-noise+latency").name == "gusts+latency-noise"
    assert tiers.get("calm+wind-wind") == tiers.get("calm")
    assert tiers.get(tiers.get("hard-noise-wind").name) == tiers.get("hard-noise-wind")
    assert tiers.get("calm+wind:2").name == tiers.get("calm+wind:2.0").name == "calm+wind:2"
    assert tiers.get("calm+wind:1").name == "calm+wind", "the strength that it is added with anyway"
    assert tiers.get("gusts+noise:2-estimation").name == "gusts+noise:2-estimation"


@pytest.mark.parametrize("strength", ["1.2345678", "0.00001", "1e-3", "2e+0", "0.30000000000000004", "0"])
def test_a_name_says_a_strength_in_all_its_digits(strength: str) -> None:
    """Recordings keep the name alone: what is flown by it once more must be what was flown."""
    tier = tiers.get(f"calm+wind:{strength}-noise")
    assert tier.strengths == {"wind": float(strength)}
    again = tiers.get(tier.name)
    assert (again.name, again.parts) == (tier.name, tier.parts)


@pytest.mark.parametrize(
    ("component", "strength", "another"),
    [
        ("wind", 2, 1.6), ("noise", 2, 1.6), ("estimation", 2, 1.6), ("payload", 0.3, 0.2), ("latency", 3, 1),
        ("motors", 0.85, 0.7), ("camera_shift", 0.05, 0.1), ("camera_tilt", 5, 10), ("lens", 2, 3), ("looks", 2, 1.5),
    ],
)  # fmt: skip
def test_a_strength_is_flown_and_recorded(component: str, strength: float, another: float) -> None:
    seen = tiers.standard(component).seen_alone
    looks = {"cameras": ("wrist",), "image_size": (24, 32)} if seen else {}
    flown = []
    for tier in ("calm", f"calm+{component}:{strength:g}", f"calm+{component}:{another:g}"):
        env = aerial_il.load_batch("ua_quad_arm4", "pick_place", num_envs=2, tier=tier, **looks)
        env.reset(np.array([5, 6]))
        for action in random_actions(env.spec.action, 20, 2):
            obs = env.step(action).obs
        flown.append(np.concatenate([np.ravel(values) for values in obs.values()]))
        assert env.spec.tier == tier
    calm, disturbed, otherwise = flown
    assert not np.array_equal(calm, disturbed)
    assert not np.array_equal(otherwise, disturbed)


def test_friction_of_a_strength_is_the_same_in_every_episode() -> None:
    env = aerial_il.load_batch("ua_quad_arm4", "open_door", num_envs=2, tier="calm+friction:0.5")
    nominal = env.simulation.worlds.model.geom_friction[:, 0].copy()
    env.reset(np.array([5, 6]))
    assert env.drawn(5)["contact_friction"] == env.drawn(6)["contact_friction"] == 0.5
    for world in range(2):
        own = env.simulation.worlds.own_model(world)
        np.testing.assert_allclose(own.geom_friction[:, 0], 0.5 * nominal)


def test_a_tier_is_fixed_and_describes_itself_in_plain_values() -> None:
    tier = tiers.get("hard-wind")
    with pytest.raises(dataclasses.FrozenInstanceError):
        tier.parts = {}  # type: ignore[misc]
    described = json.loads(json.dumps(tier.to_dict()))
    assert tuple(described) == tier.components
    assert described["payload"] == {"object_mass": 0.3, "base_mass": 0.05}
    assert described["latency"] == {"least": 1, "most": 2}


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("gust", "Unknown tier 'gust'. Did you mean 'gusts'"),
        ("storm+wind", "Unknown tier 'storm'"),
        ("", "Unknown tier ''"),
        ("calm+wnd", "Unknown tier component 'wnd'. Did you mean 'wind'"),
        ("calm+", "Unknown tier component ''"),
        ("hard--wind", "Unknown tier component ''"),
        ("gusts+payload+wind", "has wind anyway; its components: wind, payload, noise"),
        ("calm-payload", "has no payload anyway; its components: noise"),
        (
            "calm+wind:9",
            "wind:9 is not possible: its strength is a number from 0 to 3 (times the change of drag in `gusts`)",
        ),
        ("calm+wind:nan", "its strength is a number from 0 to 3"),
        ("calm+wind:", "its strength is a number from 0 to 3"),
        ("calm+latency:1.5", "A latency of 1.5 control steps is not possible"),
        ("calm-noise:2", "a component is removed whole, without a strength: -noise"),
        ("calm-noise-noise", "has no noise anyway; its components: none"),
    ],
)
def test_wrong_names_are_answered_with_what_is_valid(name: str, says: str) -> None:
    with pytest.raises((UnknownNameError, InvalidValueError)) as caught:
        tiers.get(name)
    assert says in str(caught.value)
    assert any(component in str(caught.value) for component in tiers.components())


CELL = ("ua_quad_arm4", "reach")


@pytest.mark.parametrize("law", registry.names("controller"))
def test_a_stored_state_resumes_and_one_world_equals_a_batch(law: str) -> None:
    batch = aerial_il.load_batch(*CELL, num_envs=3, tier="gusts", controller=law)
    single = aerial_il.load(*CELL, tier="gusts", controller=law, seed=1)
    actions = random_actions(batch.spec.action, 12, 3)
    single.reset()
    for step in range(6):
        batch.step(actions[step])
        single.step(actions[step, 1])
    half = batch.get_state()
    np.testing.assert_array_equal(half[1], single.get_state()[0])
    ends = []
    for _ in range(2):
        batch.set_state(half)
        for step in range(6, 12):
            batch.step(actions[step])
        ends.append(batch.get_state())
    np.testing.assert_array_equal(*ends)
    integrals = batch.simulation.view.userdata[:, layout.LAW : layout.LAW + layout.LAW_SIZE]
    assert integrals.any() == (law == "pid"), "the integrators are part of the state"
    batch.close()
    single.close()


def test_the_specification_says_which_law_flies() -> None:
    with gymnasium.make("aerial_il/reach-ua_quad_arm4-v0", controller="lqr") as env:
        spec = env.unwrapped.aerial.spec
    assert spec.controller == "lqr"
    assert EnvSpec.from_dict(spec.to_dict()).controller == "lqr"
    old = {key: value for key, value in spec.to_dict().items() if key != "controller"}
    assert EnvSpec.from_dict(old).controller == "geometric_observer", "recordings from before there was a choice"
    assert spec.differences(EnvSpec.from_dict(old)) == []
    assert spec.differences(EnvSpec.from_dict(old), ignore=()) == ["controller: 'lqr' != 'geometric_observer'"]


def test_a_reset_without_seeds_goes_on_with_the_next_ones() -> None:
    worlds, others = (aerial_il.load_batch("quad", "hover", num_envs=2, num_threads=1, seed=4) for _ in range(2))
    assert worlds.seeds.tolist() == [4, 5]
    seen, same = worlds.reset(), others.reset(6)
    assert worlds.seeds.tolist() == [6, 7]
    assert all(np.array_equal(seen[name], same[name]) for name in same)
    worlds.reset(mask=np.array([True, False]))
    assert worlds.seeds.tolist() == [8, 7]


def test_observations_have_one_name_everywhere() -> None:
    single = aerial_il.load("quad", "hover").reset()
    worlds = aerial_il.load_batch("quad", "hover", num_envs=2, num_threads=1)
    step = worlds.step(np.zeros((2, worlds.spec.action.size)))
    assert step.observation is step.obs
    assert set(step.observation) == set(single.observation)


def test_worlds_are_flown_by_all_cores_where_nobody_says_how_many(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CORES, "3")
    assert [ThreadPool(8, threads).hands for threads in (0, 1, 2)] == [3, 1, 2]
    monkeypatch.delenv(CORES)
    assert ThreadPool(8).hands == min(8, available_cores())
