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
from aerial_il.suite import tiers
from tests.contract.registered import random_actions


def test_the_tiers_grow_rougher() -> None:
    assert tiers.names() == ("calm", "breeze", "gusts", "hard")
    assert [tiers.get(name).name for name in tiers.names()] == list(tiers.names())
    assert tiers.get("calm").components == ("noise",)
    assert tiers.get("breeze").components == ("wind", "noise")
    assert tiers.get("gusts").components == ("wind", "noise", "estimation")
    assert tiers.get("hard").components == tiers.components()
    shares = [tiers.get(name).to_dict()["wind"]["share"] for name in ("breeze", "gusts", "hard")]
    assert shares == [0.06, 0.13, 0.13]


@pytest.mark.parametrize("component", tiers.components())
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
        ("calm-noise-noise", "has no noise anyway; its components: none"),
    ],
)
def test_wrong_names_are_answered_with_what_is_valid(name: str, says: str) -> None:
    with pytest.raises((UnknownNameError, InvalidValueError)) as caught:
        tiers.get(name)
    assert says in str(caught.value)
    assert "wind" in str(caught.value) or "noise" in str(caught.value)


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
