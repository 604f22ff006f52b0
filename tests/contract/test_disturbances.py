"""Every registered disturbance: plain settings, kernels that stay within their memory, flights that repeat."""

from __future__ import annotations

import json
from dataclasses import FrozenInstanceError, asdict, fields
from typing import Any

import numpy as np
import pytest

from aerial_il import robots
from aerial_il.core import registry
from aerial_il.suite import disturbances, tiers
from aerial_il.suite.disturbances.disturbance import Disturbance, Start
from aerial_il.suite.physics import episode_state as layout
from aerial_il.suite.physics.hooks import EFFECTS, NOW
from tests.contract.registered import batch, random_actions, single

ROBOT, TASK, SEEDS = "ua_quad_arm4", "pick_place", np.array([3, 4, 5])
STEPS, MARGIN, UNTOUCHED = 50, 16, 123.25
each_disturbance = pytest.mark.parametrize("name", registry.names("disturbance"))


def tier_with(name: str) -> str:
    """A tier in which it is at work."""
    return "calm" if "calm" in disturbances.strengths(name) else f"calm+{name}"


def in_margins(numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a copy of ``numbers`` and the whole array of which it is the middle."""
    whole = np.full(numbers.size + 2 * MARGIN, UNTOUCHED)
    whole[MARGIN : MARGIN + numbers.size] = numbers
    return whole[MARGIN : MARGIN + numbers.size], whole


def run_kernels(name: str, part: Disturbance, *, compiled: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Call the kernels for some control steps; return memory, action and the last effects."""
    robot, size = robots.get(ROBOT), 10
    own = part.record(name, robot).view(np.recarray)[0]
    memory, guarded = in_margins(part.start(Start(np.random.default_rng(1), lambda: np.zeros(size))))
    action, guarded_action = in_margins(np.zeros(size))
    now, effects = np.zeros(1, NOW).view(np.recarray)[0], np.zeros(1, EFFECTS).view(np.recarray)[0]
    now.seed, now.dt, now.quat[0], now.pos[2] = 7.0, 0.02, 1.0, 1.0
    hooks = {hook: each if compiled else each.py_func for hook, each in disturbances.kernels(name).items()}
    given: dict[str, tuple[Any, ...]] = {"arrive": (action,), "advance": (), "act": (effects,)}
    for step in range(STEPS):
        action[:] = step
        for hook, call in hooks.items():
            effects.fill(0.0) if hook == "act" else None
            call(own, memory, now, *given[hook])
        now.tick += 5.0
    for array in (guarded, guarded_action):
        assert (array[:MARGIN] == UNTOUCHED).all(), f"{name} writes before what is its own"
        assert (array[-MARGIN:] == UNTOUCHED).all(), f"{name} writes beyond what is its own"
    return memory.copy(), action.copy(), np.array(effects.tolist()).ravel()


@each_disturbance
def test_settings_are_plain_frozen_and_explained(name: str) -> None:
    part = tiers.standard(name)
    assert json.loads(json.dumps(asdict(part))) == asdict(part)
    with pytest.raises((FrozenInstanceError, AttributeError)):
        setattr(part, fields(part)[0].name, 1.0)
    text = type(part).__doc__ or ""
    assert all(field.name in text for field in fields(part)), "each setting is explained"
    assert set(disturbances.strengths(name)) <= set(tiers.names())
    assert all(isinstance(each, type(part)) for each in disturbances.strengths(name).values())


@each_disturbance
def test_it_does_something(name: str) -> None:
    part = tiers.standard(name)
    assert disturbances.kernels(name) or part.varies or name == "estimation"


@each_disturbance
def test_its_memory_is_of_the_size_that_it_says(name: str) -> None:
    part = tiers.standard(name)
    assert part.start(Start(np.random.default_rng(0), lambda: np.zeros(10))).shape == (part.memory,)
    if name in layout.MEMORIES:
        place = layout.MEMORIES[name]
        assert place.stop - place.start == part.memory


@each_disturbance
def test_kernels_stay_within_their_memory(name: str) -> None:
    part = tiers.standard(name)
    plain, again, fast = (run_kernels(name, part, compiled=compiled) for compiled in (False, False, True))
    for one, other, compiled in zip(plain, again, fast, strict=True):
        assert np.isfinite(one).all()
        np.testing.assert_array_equal(one, other, err_msg="the same moments have the same effects")
        np.testing.assert_allclose(one, compiled, rtol=1e-12, atol=1e-12)


@each_disturbance
def test_a_flight_repeats_resumes_and_needs_no_company(name: str) -> None:
    tier = tier_with(name)
    worlds, alone = batch(ROBOT, TASK, tier, "velocity"), single(ROBOT, TASK, tier, "velocity")
    actions = random_actions(worlds.spec.action, 12, 3)
    worlds.reset(SEEDS)
    alone.reset(seed=int(SEEDS[1]))
    states = []
    for action in actions:
        worlds.step(action)
        alone.step(action[1])
        states.append(worlds.get_state())
    np.testing.assert_array_equal(states[-1][1], alone.get_state()[0])
    worlds.set_state(states[5])
    for action in actions[6:]:
        worlds.step(action)
    np.testing.assert_array_equal(worlds.get_state(), states[-1])


@each_disturbance
def test_what_is_drawn_is_recorded(name: str) -> None:
    worlds = batch(ROBOT, TASK, tier_with(name), "velocity")
    drawn = [json.loads(json.dumps(worlds.drawn(seed))) for seed in (3, 3, 4)]
    assert drawn[0] == drawn[1]
    recorded = json.loads(json.dumps(worlds.spec.disturbances))[name]
    assert recorded.get("memory", 0) == tiers.standard(name).memory


def test_calm_has_noise_alone() -> None:
    assert [name for name in registry.names("disturbance") if "calm" in disturbances.strengths(name)] == ["noise"]
