"""Decisions that last several steps: their advantages by hand, the noise of chunks, the gate, episodes cut short."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from aerial_il.algorithms.decisions.chunk_actor import ChunkActor
from aerial_il.algorithms.decisions.cut_short import cut_short
from aerial_il.algorithms.decisions.gate import ReturnGate
from aerial_il.algorithms.decisions.rollout import Decisions, advantages
from aerial_il.algorithms.online.collector import Collector
from aerial_il.algorithms.online.smoothness import Smoothness
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.layout import Layout
from aerial_il.policies.parts.network import ChunkNetwork
from tests.algorithms.drift import SPEC, Drift

PLAIN = MLP(hidden=(8,), chunk=4, anchor=None, blind_to=())


def rollout(decided: list[int], *, terminal: tuple[int, ...] = (), truncated: tuple[int, ...] = ()) -> Decisions:
    """One world for six steps, each paid its number."""
    steps, nothing = np.arange(6), np.zeros((6, 1, 1))
    flags = [np.isin(steps, which)[:, None] for which in (decided, terminal, truncated)]
    return Decisions(nothing, flags[0], nothing, nothing, steps[:, None].astype(float), *flags[1:])


def test_a_decision_is_worth_what_is_paid_until_the_next_one() -> None:
    """Decisions at steps 0, 2 and 5; the second outlives no end, the third is cut by the rollout's."""
    values = np.arange(10.0, 16.0)[:, None]
    after = values + 1.0  # of the state after each step: what the next step's begins with
    found, closing = advantages(rollout([0, 2, 5]), values, after, np.arange(6.0)[:, None], gamma=0.5, gae_lambda=0.8)
    last = 5 + 0.5 * 16 - 15
    second = 2 + 0.5 * 3 + 0.25 * 4 + 0.125 * 15 - 12 + 0.8 * 0.125 * last
    first = 0 + 0.5 * 1 + 0.25 * 12 - 10 + 0.8 * 0.25 * second
    np.testing.assert_allclose(found[[0, 2, 5], 0], [first, second, last])
    np.testing.assert_array_equal(closing[[0, 2, 5], 0], [1, 4, 5])


@pytest.mark.parametrize(("kind", "worth"), [("terminal", 0.0), ("truncated", 7.0)])
def test_nothing_follows_an_end_and_a_cut_is_worth_what_the_critic_sees(kind: str, worth: float) -> None:
    values, after = np.zeros((6, 1)), np.full((6, 1), 7.0)
    ended = {"terminal": (1,)} if kind == "terminal" else {"truncated": (1,)}
    found, _ = advantages(rollout([0, 2], **ended), values, after, np.ones((6, 1)), gamma=0.5, gae_lambda=1.0)
    assert found[0, 0] == pytest.approx(1 + 0.5 + 0.25 * worth), "whatever comes in the next episode"


def actor(correlation: float = 0.9, deviation: float = 0.2) -> ChunkActor:
    torch.manual_seed(0)
    network, explored = PLAIN.build(2, 3), np.array([True, False, True])
    return ChunkActor(network, history=1, execute=3, explored=explored, deviation=deviation, correlation=correlation)


def test_the_density_of_a_chunk_is_that_of_its_correlated_noise() -> None:
    """Against torch's own Gaussian with the covariance written out."""
    one, obs = actor(), torch.randn(5, 1, 2)
    actions, raw, density = one.sample(obs)
    mean, _ = one.distribution(obs)
    lag = (torch.arange(3)[:, None] - torch.arange(3)).abs()
    noise = torch.distributions.MultivariateNormal(torch.zeros(3), 0.2**2 * 0.9**lag)
    apart = (raw.unflatten(1, (3, 2)) - mean).transpose(1, 2)
    torch.testing.assert_close(density, noise.log_prob(apart).sum(1), rtol=1e-3, atol=1e-3)
    torch.testing.assert_close(one.judge(obs, raw)[0], density)
    still = one(obs)[:, :3, 1]
    torch.testing.assert_close(actions.unflatten(1, (3, 3))[..., 1], still)
    torch.testing.assert_close(one.drawn_of(actions.unflatten(1, (3, 3))), raw)


def test_the_divergence_of_two_actors_is_that_of_their_gaussians() -> None:
    one, other, obs = actor(), actor(deviation=0.3), torch.randn(5, 1, 2)
    with torch.no_grad():
        other.network.layers[-1].bias.add_(0.1)
    found = one.divergence(one.distribution(obs), other.distribution(obs))
    cov = 0.9 ** (torch.arange(3)[:, None] - torch.arange(3)).abs()
    apart = (one.distribution(obs)[0] - other.distribution(obs)[0]).transpose(1, 2)
    wanted = torch.zeros(5)
    for element in range(2):
        pair = (
            torch.distributions.MultivariateNormal(mean, scale**2 * cov)
            for mean, scale in ((apart[:, element], 0.2), (torch.zeros(5, 3), 0.3))
        )
        wanted += torch.distributions.kl_divergence(*pair)
    torch.testing.assert_close(found, wanted, rtol=1e-3, atol=1e-3)
    assert one.divergence(one.distribution(obs), one.distribution(obs)).abs().max() < 1e-5


def returns(*values: float) -> Decisions:
    """Episodes of one step."""
    paid = np.array(values)[:, None]
    ended, nothing = np.ones((len(values), 1), bool), np.zeros((len(values), 1, 1))
    return Decisions(nothing, ended, nothing, nothing, paid, ended, ~ended)


def move(weight: torch.Tensor) -> torch.Tensor:
    """Learn something, whatever it is; return a copy of the weight."""
    with torch.no_grad():
        return weight.add_(1.0).clone()


GOOD, BAD = returns(*[1.0, 0.0] * 10), returns(*[0.0] * 20)


def test_weights_that_fly_worse_than_the_prior_are_given_up_for_the_last_that_did_not() -> None:
    one = actor()
    gate, weight = ReturnGate(one, 1, errors=2.0), one.network.layers[-1].bias
    begun = weight.detach().clone()
    assert not gate.passes(GOOD, warming_up=True), "nothing is learned yet"
    assert gate.passes(GOOD, warming_up=False)
    moved = move(weight)
    assert gate.passes(GOOD, warming_up=False)
    move(weight)
    assert not gate.passes(BAD, warming_up=False)
    torch.testing.assert_close(weight.detach(), moved)
    assert not gate.passes(returns(*[0.0] * 60), warming_up=False), "what was kept is worse after all"
    torch.testing.assert_close(weight.detach(), begun)
    assert gate.passes(GOOD, warming_up=False), "back at the prior, it goes on to learn"


def test_weights_that_were_given_up_to_may_go_on_where_they_were_unlucky_once() -> None:
    one = actor()
    gate, weight = ReturnGate(one, 1, errors=2.0), one.network.layers[-1].bias
    assert gate.passes(GOOD, warming_up=False)
    moved = move(weight)
    assert gate.passes(GOOD, warming_up=False)
    move(weight)
    assert not gate.passes(BAD, warming_up=False)
    assert gate.passes(returns(*[1.0, 0.0, 0.0] * 4), warming_up=False), "a third, and half of those before"
    torch.testing.assert_close(weight.detach(), moved)


def test_a_wide_gate_lets_everything_pass() -> None:
    one = actor()
    gate = ReturnGate(one, 1, errors=1e9)
    assert gate.passes(GOOD, warming_up=False)
    move(one.network.layers[-1].bias)
    assert gate.passes(BAD, warming_up=False)


def test_short_rollouts_are_judged_together() -> None:
    """Fewer than ten episodes end in each; a gate that looked at each alone would be open."""
    one = actor()
    gate, other = (ReturnGate(one, 1, errors=2.0) for _ in range(2))
    few, bad = returns(1.0, 1.0, 1.0, 1.0), returns(0.0, 0.0, 0.0, 0.0)
    assert [gate.passes(few, warming_up=False) for _ in range(3)] == [False, False, True], "the prior flies until ten"
    weight = one.network.layers[-1].bias
    begun = weight.detach().clone()
    move(weight)
    assert gate.passes(bad, warming_up=False)
    other.restore(gate.snapshot())
    for resumed in (gate, other):
        assert resumed.passes(bad, warming_up=False)
        assert not resumed.passes(bad, warming_up=False)
        torch.testing.assert_close(weight.detach(), begun)
        move(weight)


def test_a_prior_is_not_held_to_its_quickest_episodes() -> None:
    one = actor()
    gate, other = (ReturnGate(one, 1, errors=2.0) for _ in range(2))
    quick, usual, worse = returns(*[1.0] * 20), returns(*[1.0, 0.0] * 30), returns(*[0.0] * 20)
    assert not gate.passes(quick, warming_up=True)
    assert gate.passes(usual, warming_up=False), "the weights are the prior's still"
    weight = one.network.layers[-1].bias
    begun = weight.detach().clone()
    move(weight)
    assert not gate.passes(worse, warming_up=False)
    torch.testing.assert_close(weight.detach(), begun)
    other.restore(gate.snapshot())
    for resumed in (gate, other):
        assert resumed.passes(usual, warming_up=False), "back at the prior, it goes on to learn"
        move(weight)
        assert not resumed.passes(worse, warming_up=False)


def test_episodes_are_cut_short_and_begin_anew() -> None:
    env = cut_short(Drift(3), 4)
    assert cut_short(env, 99) is env
    collector = Collector(env, Layout.of(SPEC, PLAIN), seed=0)
    cut = [collector.step(np.zeros((3, 1))).truncated for _ in range(9)]
    np.testing.assert_array_equal(np.array(cut)[:, 0], [False, False, False, True] * 2 + [False])


class Ramp(ChunkNetwork):
    """Chunks of four steps that rise by a tenth a step; the next one goes on from there, or jumps back."""

    def __init__(self, *, goes_on: float) -> None:
        super().__init__()
        self.rate, self.goes_on = torch.nn.Parameter(torch.tensor(0.1)), goes_on

    def forward(self, obs: torch.Tensor) -> torch.Tensor:
        return self.rate * (self.goes_on * obs[:, -1:, :1] + torch.arange(4.0)[:, None])

    def loss(self, obs: torch.Tensor, actions: torch.Tensor, valid: torch.Tensor) -> Any:
        raise NotImplementedError


@pytest.mark.parametrize(("goes_on", "wanted"), [(1.0, 0.1**2), (0.0, (0.1**2 + 0.1**2 + 0.2**2) / 3)])
def test_caps_of_chunks_counts_changes_from_each_flown_step_to_the_next(goes_on: float, wanted: float) -> None:
    """Chunks that go on where the last one ended are smoother than ones that jump back at every decision."""
    here = torch.tensor([[0.0], [5.0]])  # steps so far; three are flown of each chunk
    kinds = {"history": 1, "execute": 3, "explored": np.ones(1, bool), "deviation": 0.2, "correlation": 0.9}
    one = ChunkActor(Ramp(goes_on=goes_on), **kinds)
    rough = Smoothness(temporal=2.0).loss(one, here, here + 3.0, execute=one.execute)
    assert isinstance(rough, torch.Tensor)
    assert rough.item() == pytest.approx(2.0 * wanted)
