"""Tiers are named, taken apart and put together by one grammar; a wrong name is answered with the right ones."""

from __future__ import annotations

import dataclasses
import json

import pytest

from aerial_il import robots
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.suite import tiers


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


def test_noise_scales_the_errors_of_the_estimate() -> None:
    robot = robots.get("quad")
    once, more = (tiers.get(name).parts["noise"].numbers(robot) for name in ("gusts", "hard"))
    assert once == {"position": 0.002, "velocity": 0.01, "attitude": 0.003, "rate": 0.01, "time": 0.1}
    assert more == pytest.approx({"position": 0.003, "velocity": 0.015, "attitude": 0.0045, "rate": 0.015, "time": 0.1})


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
