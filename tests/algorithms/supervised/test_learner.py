"""Schedule, averaged weights and optimiser state behave as documented."""

from __future__ import annotations

import numpy as np
import torch
from torch import nn

from aerial_il.algorithms.run.train_state import adamw, from_arrays, to_arrays
from aerial_il.algorithms.supervised.learner import Learner, cosine
from aerial_il.policies.mlp import MLP


def test_the_learning_rate_warms_up_peaks_and_ends_at_its_floor() -> None:
    factors = np.array([cosine(step / 1000, step, warmup_steps=100, floor=0.1) for step in range(1001)])
    assert (np.diff(factors[:90]) > 0).all()
    assert (np.diff(factors[110:]) < 0).all()
    assert factors[0] == 0.01
    assert factors.max() > 0.97
    np.testing.assert_allclose(factors[-1], 0.1)


def test_averaged_weights_are_the_documented_recursion() -> None:
    network = MLP(anchor=None, hidden=(8,), chunk=2).build(3, 2)
    learner = Learner(network, weight_decay=0.0, ema=0.9, clip_norm=1.0)
    expected = [weight.detach().clone() for weight in network.parameters()]
    for step in range(30):
        learner.descend(network(torch.ones(4, 1, 3)).square().mean(), lr=0.1, logged={})
        decay = min(0.9, (1 + step) / (10 + step))
        expected = [decay * e + (1 - decay) * w.detach() for e, w in zip(expected, network.parameters(), strict=True)]
    for average, wanted in zip(learner.averaged.parameters(), expected, strict=True):
        torch.testing.assert_close(average, wanted)


def test_only_matrices_decay() -> None:
    optimizer = adamw(nn.Sequential(nn.Linear(3, 3), nn.LayerNorm(3)), weight_decay=0.1)
    decays = {len(group["params"]): group["weight_decay"] for group in optimizer.param_groups}
    assert decays == {1: 0.1, 3: 0.0}


def test_a_restored_optimiser_goes_on_bit_for_bit() -> None:
    def advance(network: nn.Module, optimizer: torch.optim.Optimizer, steps: range) -> None:
        for step in steps:
            optimizer.zero_grad()
            (network(torch.full((4, 3), float(step))) ** 2).sum().backward()
            optimizer.step()

    torch.manual_seed(0)
    network = nn.Linear(3, 3)
    optimizer = adamw(network, weight_decay=0.01)
    advance(network, optimizer, range(5))
    copy = nn.Linear(3, 3)
    copy.load_state_dict(network.state_dict())
    resumed = adamw(copy, weight_decay=0.01)
    from_arrays(resumed, to_arrays(optimizer))
    advance(network, optimizer, range(5, 9))
    advance(copy, resumed, range(5, 9))
    assert all(torch.equal(a, b) for a, b in zip(network.parameters(), copy.parameters(), strict=True))
