"""Advantages, rewards that are scaled, minibatches, and natural gradient steps beside those written out."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from aerial_il.algorithms.npg import NPG, NaturalGradientAgent, conjugate_gradients, flat_gradient
from aerial_il.algorithms.on_policy.actor_critic import minibatches
from aerial_il.algorithms.on_policy.advantages import Advantages, RewardNorm, gae
from aerial_il.algorithms.ppo import PPO
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.squashed_gaussian import SquashedGaussian


def of_steps(*columns: np.ndarray, **factors: float) -> np.ndarray:
    """Return the advantages of steps that are a decision each."""
    return gae(*columns, np.ones_like(columns[0], bool), **factors)[0]


def test_advantages_are_the_sum_over_the_rest_of_each_episode() -> None:
    rng = np.random.default_rng(0)
    rewards, values, later = rng.normal(size=(3, 12, 4))
    ended = rng.random((12, 4)) < 0.2
    gamma, decay = 0.9, 0.8
    result = of_steps(rewards, values, later, ended, gamma=gamma, gae_lambda=decay)
    for world in range(4):
        for t in range(12):
            total, weight = 0.0, 1.0
            for k in range(t, 12):
                total += weight * (rewards[k, world] + gamma * later[k, world] - values[k, world])
                if ended[k, world]:
                    break
                weight *= gamma * decay
            assert result[t, world] == pytest.approx(total)


def test_a_time_limit_is_no_loss() -> None:
    """With an exact critic, whatever cuts the episodes, no step is better or worse than expected."""
    gamma = 0.9
    rewards, value = np.ones((6, 1)), np.full((6, 1), 1 / (1 - gamma))
    ended = np.array([[False], [False], [True]] * 2)
    np.testing.assert_allclose(of_steps(rewards, value, value, ended, gamma=gamma, gae_lambda=0.95), 0.0, atol=1e-12)
    lost = np.where(ended, 0.0, value)
    assert (of_steps(rewards, value, lost, ended, gamma=gamma, gae_lambda=0.95) < 0).all()


def test_scaled_rewards_have_returns_of_deviation_one() -> None:
    rewards = np.random.default_rng(0).normal(5.0, 50.0, (4000, 2))
    scale = RewardNorm(2, gamma=0.9)
    scaled = scale.scale(rewards, np.zeros_like(rewards, bool))
    total, seen = np.zeros(2), []
    for row in scaled:
        total = 0.9 * total + row
        seen.append(total)
    assert np.std(seen) == pytest.approx(1.0, rel=1e-6)


def test_no_minibatch_has_a_single_row() -> None:
    """Its advantages have no deviation to be divided by."""
    assert [len(part) for part in minibatches(2049, 1024)] == [1024, 1025]
    assert [len(part) for part in minibatches(2050, 1024)] == [1024, 1024, 2]
    assert torch.cat(minibatches(129, 64)).sort().values.tolist() == list(range(129))
    assert [len(part) for part in minibatches(2049, None)] == [2049]
    for wrong in ("batch_size", "steps"):
        with pytest.raises(InvalidValueError, match=f"{wrong} is 1; .*so at least 2"):
            replace(PPO.rollout, **{wrong: 1})


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
    result = conjugate_gradients(lambda v: matrix @ v, wanted, 20)
    assert torch.allclose(matrix @ result, wanted, atol=1e-3)
