"""What a policy remembers of its worlds can be kept, and it acts on as if nothing had been."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from aerial_il.algorithms.bc import BC
from aerial_il.policies import load_policy
from aerial_il.policies.diffusion import Diffusion
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.network import PolicySettings
from tests.algorithms.drift import Drift, demonstrations

CHUNKS = {"chunk": 4, "anchor": None, "masked_fields": ()}
CASES: dict[str, PolicySettings] = {
    "averaged": MLP(hidden=(8,), history=2, execute=1, ensemble=0.1, **CHUNKS),
    "one after the other": MLP(hidden=(8,), execute=3, ensemble=None, **CHUNKS),
    "with chance": Diffusion(**CHUNKS),
}


@pytest.mark.parametrize("case", CASES)
def test_a_policy_goes_on_in_the_middle_of_its_plans(tmp_path: Path, case: str) -> None:
    short = BC(steps=3, batch_size=8, warmup_steps=1, validation=0.0, validate_every=0)
    short.train(demonstrations(4), CASES[case], run=tmp_path, progress=False)
    policy, other = load_policy(tmp_path), load_policy(tmp_path).fresh()
    env = Drift(3)
    obs = env.reset(0)
    for step in range(5):
        if step == 2:
            policy.reset(np.array([False, True, False]))  # plans of different ages
        obs = env.step(policy.act(obs)).obs
    memory = policy.memory()
    other.recall(memory)
    forgetful, first = policy.fresh(), policy.act(obs)
    assert not np.array_equal(forgetful.act(obs), first), "what is remembered decides"
    np.testing.assert_array_equal(other.act(obs), first)
    policy.recall(memory)
    np.testing.assert_array_equal(policy.act(obs), first)
    for _ in range(4):
        obs = env.step(policy.act(obs)).obs
        other.act(obs)
    policy.recall(memory)
    assert set(memory) == set(policy.memory())
