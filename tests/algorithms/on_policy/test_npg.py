"""Natural gradient steps beside those that are written out."""

from __future__ import annotations

import pytest
import torch

from aerial_il.algorithms.npg import NPG, NaturalGradientAgent, conjugate_gradients, flat_gradient
from aerial_il.algorithms.on_policy.advantages import Advantages
from aerial_il.policies.squashed_gaussian import SquashedGaussian


def test_natural_steps_are_those_of_the_fisher_information() -> None:
    torch.manual_seed(0)
    actor = SquashedGaussian(hidden=(3,), activation="tanh", spread="free").build(2, 1)
    settings = NPG(cg_damping=0.05, cg_iterations=50, step_size=1e-3)
    agent, obs = NaturalGradientAgent(settings, actor, 2), torch.randn(400, 2)
    raw = actor.sample(obs[:, None])[1].detach()
    weights, advantages = list(actor.parameters()), torch.randn(400)
    data = Advantages(obs, obs, raw, advantages, advantages)
    before = torch.cat([w.detach().reshape(-1) for w in weights])
    mean, log_std = actor.gaussian(obs[:, None])
    by_mean = torch.stack([flat_gradient(m, weights, keep=True) for m in mean[:, 0]])
    by_spread = flat_gradient(log_std[0, 0], weights, keep=True)
    deviation = log_std[0, 0].exp()
    fisher = by_mean.T @ by_mean / len(obs) / deviation**2 + 2.0 * torch.outer(by_spread, by_spread)
    damped = (fisher + 0.05 * torch.eye(len(fisher))).detach().double()
    gradient = flat_gradient((actor.judge(obs[:, None], raw)[0] * data.standardised).mean(), weights)
    natural = torch.linalg.solve(damped, gradient.double())
    wanted = natural * (settings.step_size / (gradient.double() @ natural)).sqrt()
    metrics = agent.improve(data)
    moved = torch.cat([w.detach().reshape(-1) for w in weights]) - before
    assert torch.allclose(moved.double(), wanted, rtol=0.05, atol=0.02 * float(wanted.abs().max()))
    assert metrics["actor/approx_kl"] == pytest.approx(float(0.5 * wanted @ fisher.detach().double() @ wanted), rel=0.2)


def test_conjugate_gradients_solve() -> None:
    torch.manual_seed(0)
    root = torch.randn(5, 5)
    matrix, wanted = root @ root.T + torch.eye(5), torch.randn(5)
    found = conjugate_gradients(lambda v: matrix @ v, wanted, 20)
    assert torch.allclose(matrix @ found, wanted, atol=1e-3)
