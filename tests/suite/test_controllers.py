"""A flight law is chosen where an environment is loaded, is part of its specification, and resumes bit for bit."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

import aerial_il
from aerial_il.control import controller_state as layout
from aerial_il.core import registry
from aerial_il.core.specs import EnvSpec
from tests.contract.registered import random_actions

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
