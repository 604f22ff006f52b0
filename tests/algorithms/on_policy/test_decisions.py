"""Decisions that last several steps: their advantages by hand, the noise of chunks, the gate, episodes cut short."""

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
import torch

from aerial_il.algorithms.on_policy.actor_critic import ActorCritic
from aerial_il.algorithms.on_policy.advantages import Judged
from aerial_il.algorithms.on_policy.chunk_actor import ChunkActor
from aerial_il.algorithms.on_policy.cut_short import cut_short
from aerial_il.algorithms.on_policy.decisions import Decisions
from aerial_il.algorithms.on_policy.gate import ReturnGate
from aerial_il.algorithms.on_policy.loop import judged
from aerial_il.algorithms.online.collector import Collector
from aerial_il.algorithms.online.smoothness import NO_SMOOTHNESS
from aerial_il.algorithms.ppo import PPO
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.layout import Layout
from aerial_il.policies.parts.network import ChunkNetwork
from tests.algorithms.drift import SPEC, Drift

PLAIN = MLP(hidden=(8,), chunk=4, anchor=None, masked_fields=())


class Seen:
    """A critic that answers with the first number that it is shown."""

    def values(self, obs: np.ndarray) -> np.ndarray:
        return obs[..., 0]


SEEN = cast(ActorCritic, Seen())


def advantages(decided: list[int], values: np.ndarray, after: np.ndarray, rewards: np.ndarray, **ends: Any) -> Judged:
    """Return what is made of the decisions of one world in six steps, at a discount of a half."""
    steps, chosen = np.arange(6), PPO(gamma=0.5, gae_lambda=ends.pop("gae_lambda", 0.8))
    flags = [np.isin(steps, which)[:, None] for which in (decided, ends.get("terminal", ()), ends.get("truncated", ()))]
    seen, led = (numbers[:, None, None] for numbers in (values, after))
    rollout = Decisions(seen, flags[0], np.zeros((6, 1, 1)), led, rewards[:, None], *flags[1:])
    result = judged(rollout, rollout.rewards, 0.0, SEEN, chosen)
    assert result is not None
    return result


def test_a_decision_has_the_value_of_what_is_paid_until_the_next() -> None:
    """Decisions at steps 0, 2 and 5, each step paid its number; the last decision is cut by the rollout's end."""
    values = np.arange(10.0, 16.0)
    result = advantages([0, 2, 5], values, values + 1.0, np.arange(6.0))  # a step's end is worth the next one's start
    last = 5 + 0.5 * 16 - 15
    second = 2 + 0.5 * 3 + 0.25 * 4 + 0.125 * 15 - 12 + 0.8 * 0.125 * last
    first = 0 + 0.5 * 1 + 0.25 * 12 - 10 + 0.8 * 0.25 * second
    np.testing.assert_allclose(result.data.advantages, [first, second, last], rtol=1e-6)
    np.testing.assert_array_equal(result.data.next_obs[:, 0], [12, 15, 16])
    np.testing.assert_allclose(result.data.targets, result.data.advantages + torch.tensor([10.0, 12.0, 15.0]))
    assert result.value == pytest.approx(37 / 3)


@pytest.mark.parametrize(("kind", "value"), [("terminal", 0.0), ("truncated", 7.0)])
def test_nothing_follows_an_end_but_the_critic_speaks_of_a_cut(kind: str, value: float) -> None:
    result = advantages([0, 2], np.zeros(6), np.full(6, 7.0), np.ones(6), gae_lambda=1.0, **{kind: (1,)})
    assert result.data.advantages[0] == pytest.approx(1 + 0.5 + 0.25 * value), "whatever comes in the next episode"


def test_a_single_decision_is_compared_with_nothing() -> None:
    alone, never = np.zeros((6, 1, 1)), np.zeros((6, 1), bool)
    rollout = Decisions(alone, (np.arange(6) == 0)[:, None], alone, alone, np.zeros((6, 1)), never, never)
    assert judged(rollout, rollout.rewards, 0.0, SEEN, PPO()) is None


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
    result = one.divergence(one.distribution(obs), other.distribution(obs))
    cov = 0.9 ** (torch.arange(3)[:, None] - torch.arange(3)).abs()
    apart = (one.distribution(obs)[0] - other.distribution(obs)[0]).transpose(1, 2)
    wanted = torch.zeros(5)
    for element in range(2):
        pair = (
            torch.distributions.MultivariateNormal(mean, scale**2 * cov)
            for mean, scale in ((apart[:, element], 0.2), (torch.zeros(5, 3), 0.3))
        )
        wanted += torch.distributions.kl_divergence(*pair)
    torch.testing.assert_close(result, wanted, rtol=1e-3, atol=1e-3)
    assert one.divergence(one.distribution(obs), one.distribution(obs)).abs().max() < 1e-5


def returns(*values: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the rewards and ends of episodes of one step."""
    return np.array(values)[:, None], np.ones((len(values), 1), bool)


def move(weight: torch.Tensor) -> torch.Tensor:
    """Learn something, whatever it is; return a copy of the weight."""
    with torch.no_grad():
        return weight.add_(1.0).clone()


GOOD, BAD = returns(*[1.0, 0.0] * 10), returns(*[0.0] * 20)


def test_weights_that_fly_worse_give_way_to_the_last_good_ones() -> None:
    one = actor()
    gate, weight = ReturnGate(one, 1, errors=2.0), one.network.layers[-1].bias
    first = weight.detach().clone()
    assert not gate.passes(*GOOD, warming_up=True), "nothing is learned yet"
    assert gate.passes(*GOOD, warming_up=False)
    moved = move(weight)
    assert gate.passes(*GOOD, warming_up=False)
    move(weight)
    assert not gate.passes(*BAD, warming_up=False)
    torch.testing.assert_close(weight.detach(), moved)
    assert not gate.passes(*returns(*[0.0] * 60), warming_up=False), "what was kept is worse after all"
    torch.testing.assert_close(weight.detach(), first)
    assert gate.passes(*GOOD, warming_up=False), "back at the prior, it goes on to learn"


def test_weights_that_were_unlucky_once_may_go_on() -> None:
    one = actor()
    gate, weight = ReturnGate(one, 1, errors=2.0), one.network.layers[-1].bias
    assert gate.passes(*GOOD, warming_up=False)
    moved = move(weight)
    assert gate.passes(*GOOD, warming_up=False)
    move(weight)
    assert not gate.passes(*BAD, warming_up=False)
    assert gate.passes(*returns(*[1.0, 0.0, 0.0] * 4), warming_up=False), "a third, and half of those before"
    torch.testing.assert_close(weight.detach(), moved)


def test_a_wide_gate_lets_everything_pass() -> None:
    one = actor()
    gate = ReturnGate(one, 1, errors=1e9)
    assert gate.passes(*GOOD, warming_up=False)
    move(one.network.layers[-1].bias)
    assert gate.passes(*BAD, warming_up=False)


def test_short_rollouts_are_judged_together() -> None:
    """Fewer than ten episodes end in each; a gate that looked at each alone would be open."""
    one = actor()
    gate, other = (ReturnGate(one, 1, errors=2.0) for _ in range(2))
    few, bad = returns(1.0, 1.0, 1.0, 1.0), returns(0.0, 0.0, 0.0, 0.0)
    assert [gate.passes(*few, warming_up=False) for _ in range(3)] == [False, False, True], "the prior flies until ten"
    weight = one.network.layers[-1].bias
    first = weight.detach().clone()
    move(weight)
    assert gate.passes(*bad, warming_up=False)
    other.restore(gate.snapshot())
    for resumed in (gate, other):
        assert resumed.passes(*bad, warming_up=False)
        assert not resumed.passes(*bad, warming_up=False)
        torch.testing.assert_close(weight.detach(), first)
        move(weight)


def test_a_prior_is_not_held_to_its_quickest_episodes() -> None:
    one = actor()
    gate, other = (ReturnGate(one, 1, errors=2.0) for _ in range(2))
    quick, default, worse = returns(*[1.0] * 20), returns(*[1.0, 0.0] * 30), returns(*[0.0] * 20)
    assert not gate.passes(*quick, warming_up=True)
    assert gate.passes(*default, warming_up=False), "the weights are the prior's still"
    weight = one.network.layers[-1].bias
    first = weight.detach().clone()
    move(weight)
    assert not gate.passes(*worse, warming_up=False)
    torch.testing.assert_close(weight.detach(), first)
    other.restore(gate.snapshot())
    for resumed in (gate, other):
        assert resumed.passes(*default, warming_up=False), "back at the prior, it goes on to learn"
        move(weight)
        assert not resumed.passes(*worse, warming_up=False)


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
def test_caps_of_chunks_counts_changes_between_flown_steps(goes_on: float, wanted: float) -> None:
    """Chunks that go on where the last one ended are smoother than ones that jump back at every decision."""
    here = torch.tensor([[0.0], [5.0]])  # steps so far; three are flown of each chunk
    kinds = {"history": 1, "execute": 3, "explored": np.ones(1, bool), "deviation": 0.2, "correlation": 0.9}
    one = ChunkActor(Ramp(goes_on=goes_on), **kinds)
    rough = replace(NO_SMOOTHNESS, temporal=2.0).loss(one, here, here + 3.0, execute=one.execute)
    assert isinstance(rough, torch.Tensor)
    assert rough.item() == pytest.approx(2.0 * wanted)
