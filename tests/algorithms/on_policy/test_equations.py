"""The equations of learners from rollouts, against numbers written by hand: clipping, demonstrations, the pull back."""

import math
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.bc_ppo import BCPPO, AnchoredActorCritic
from aerial_il.algorithms.dapg import DAPG, AugmentedAgent, Demonstrated
from aerial_il.algorithms.on_policy.advantages import Advantages, Judged
from aerial_il.algorithms.on_policy.chunk_actor import ChunkActor
from aerial_il.algorithms.on_policy.settings import Rollout
from aerial_il.algorithms.ppo import PPO, ProximalActorCritic
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from tests.algorithms.drift import demonstrations
from tests.algorithms.hand_set import actor_at, move_actor

SMALL: dict[str, Any] = {"critic_hidden": (4,)}


# -- ppo


def judged_rows(raw: list[float], advantages: list[float]) -> Advantages:
    """Return steps that drew ``raw`` numbers, and follow their gradients."""
    count = len(raw)
    drawn = torch.tensor(raw)[:, None].requires_grad_()
    seen = torch.zeros(count, 2)
    return Advantages(seen, seen, drawn, torch.tensor(advantages), torch.zeros(count))


@pytest.mark.parametrize(
    ("ratio", "better", "worse"),
    [(1.5, False, True), (0.5, True, False), (1.1, True, True), (0.9, True, True)],
)
def test_clipped_gradients_lead_back_but_not_further(ratio: float, better: bool, worse: bool) -> None:
    """Two actions that became more, or less, likely by one factor: a better one of normalised advantage 1 / sqrt(2),
    and a worse one. A deviation of 1 around 0: the density of ``raw`` changes by ``-raw``."""
    settings = PPO(clip=0.2, **SMALL)
    agent = ProximalActorCritic(settings, actor_at([0.0], log_std=0.0), 2)
    part = judged_rows([0.6, -0.8], [3.0, 1.0])
    with torch.no_grad():
        now = agent.actor.judge(part.obs[:, None], part.raw)[0]
    loss, approx_kl, clipped = agent.actor_loss(part, now - math.log(ratio))
    gain = 1.0 / math.sqrt(2.0)
    counted = {True: min(ratio, 1.2) * gain, False: max(ratio, 0.8) * gain}
    assert loss.item() == pytest.approx(-(counted[True] - counted[False]) / 2, abs=1e-5)
    (slopes,) = torch.autograd.grad(loss, part.raw)
    by_log_density = torch.autograd.grad(agent.actor.judge(part.obs[:, None], part.raw)[0].sum(), part.raw)[0]
    wanted = -ratio * gain / 2 * torch.tensor([[1.0 * better], [-1.0 * worse]]) * by_log_density
    torch.testing.assert_close(slopes, wanted, rtol=1e-4, atol=1e-6)
    assert clipped == float(abs(ratio - 1) > 0.2)
    assert approx_kl == pytest.approx(ratio - 1 - math.log(ratio), abs=1e-5)


# -- dapg

POLICY = MLP(hidden=(16,), chunk=3, execute=3, ensemble=None, anchor=None, masked_fields=())
FLOWN = 12


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> ChunkPolicy:
    """A clone that has hardly begun to learn, so that there is something left of the demonstrations."""
    cloning = BC(steps=2, batch_size=16, warmup_steps=1, ema=0.9, validation=0.0)
    return cloning.train(demonstrations(4), POLICY, run=tmp_path_factory.mktemp("clone") / "run", progress=False)


def augmented(clone: ChunkPolicy, **changes: Any) -> tuple[AugmentedAgent, Demonstrated]:
    """Return an agent that begins with the clone, and all that it is shown."""
    torch.manual_seed(0)
    network = POLICY.build(2, 1)
    network.load_state_dict(clone.network.state_dict())
    explored = {"explored": np.array([True]), "deviation": 0.5, "correlation": 0.0}
    actor = ChunkActor(network, history=1, execute=3, **explored)
    shown = Demonstrated(demonstrations(4), clone, actor, np.random.default_rng(0))
    rollout = Rollout(steps=128, epochs=1, batch_size=4)
    settings = DAPG(**{"step_size": 0.01, "rollout": rollout, **SMALL, **changes})
    return AugmentedAgent(settings, actor, 2, shown), shown


def flown(agent: AugmentedAgent, advantages: Tensor) -> Judged:
    """Return decisions that the agent drew, with these advantages."""
    torch.manual_seed(1)
    obs = torch.randn(len(advantages), 2)
    with torch.no_grad():
        raw = agent.actor.sample(obs[:, None])[1]
    return Judged(Advantages(obs, obs, raw, advantages, advantages), 0.0)


def density(agent: AugmentedAgent, obs: Tensor, drawn: Tensor) -> Tensor:
    """Return the logarithm of the density of chunks, of independent noise of deviation 0.5 in three steps."""
    means = agent.actor(obs[:, None]).flatten(1)
    apart = ((drawn - means) / agent.actor.log_std.exp()) ** 2
    return (-0.5 * apart - agent.actor.log_std - 0.5 * math.log(2 * math.pi)).sum(1)


def test_demonstrations_weigh_a_share_of_the_best_advantage(clone: ChunkPolicy) -> None:
    """Equations 4 and 5 of the source, over the number of decisions; through the warm-up no turn is counted."""
    agent, shown = augmented(clone, demos_weight=0.5, demos_decay=0.25)
    advantages = torch.linspace(-1.0, 2.0, FLOWN)
    seen, drawn = shown.draw(10**6)
    assert len(seen) == 4 * 10, "each window of three whole steps in four flights of twelve"
    weights = []
    for improve, weight in ((False, 0.5), (True, 0.5), (False, 0.125), (True, 0.125), (True, 0.03125)):
        data = flown(agent, advantages).data
        result, gains = agent.gain(data), data.standardised
        own = (density(agent, data.obs, data.raw) * gains).mean()
        likely = density(agent, seen, drawn).sum() / FLOWN
        assert result.item() == pytest.approx((own + weight * gains.max() * likely).item(), rel=1e-3)
        metrics = agent.learn(flown(agent, advantages), left=1.0, improve=improve)
        weights += [metrics["actor/demonstrations"]] if improve else []
    assert weights == [0.5, 0.125, 0.03125]


def test_what_is_shown_are_chunks_and_what_was_seen_before_them(clone: ChunkPolicy) -> None:
    _, shown = augmented(clone)
    seen, drawn = (part.numpy() for part in shown.draw(10**6))
    flights = [
        (np.concatenate([d.obs[k] for k in ("position", "goal")], 1), d.executed_actions) for d in demonstrations(4)
    ]
    wanted = np.array([[*obs[t], *actions[t : t + 3, 0]] for obs, actions in flights for t in range(10)])
    result = np.concatenate([clone.interface.obs.denormalise(seen), clone.interface.action.denormalise(drawn)], axis=1)
    for rows in (wanted, result):
        rows[:] = rows[np.lexsort(rows.round(4).T)]
    np.testing.assert_allclose(result, wanted, atol=1e-4)


def test_each_turn_shows_so_many_windows_and_the_next_others(
    clone: ChunkPolicy, monkeypatch: pytest.MonkeyPatch
) -> None:
    agent, shown = augmented(clone, shown=8)
    turns, draw = list[Tensor](), shown.draw

    def noted(count: int) -> tuple[Tensor, Tensor]:
        drawn = draw(count)
        turns.append(drawn[0])
        return drawn

    monkeypatch.setattr(shown, "draw", noted)
    for _ in range(2):
        agent.learn(flown(agent, torch.randn(FLOWN)), left=1.0)
    assert [len(seen) for seen in turns] == [8, 8]
    assert not torch.equal(*turns)


def test_steps_lead_to_demonstrated_actions_as_these_weigh(clone: ChunkPolicy) -> None:
    """The same rollout, whose advantages are drawn blindly."""
    nearer = []
    for weight in (0.0, 10.0):
        agent, shown = augmented(clone, demos_weight=weight)
        seen, drawn = shown.draw(10**6)

        def distance(agent: AugmentedAgent = agent, seen: Tensor = seen, drawn: Tensor = drawn) -> float:
            return ((agent.actor(seen[:, None]).flatten(1) - drawn) ** 2).mean().item()

        before = distance()
        torch.manual_seed(2)
        for _ in range(5):
            agent.learn(flown(agent, torch.randn(FLOWN)), left=1.0)
        nearer.append(before - distance())
    assert nearer[1] > 0.02
    assert nearer[1] > 3 * abs(nearer[0])


def test_without_a_better_action_demonstrations_do_not_count(clone: ChunkPolicy) -> None:
    """As in the source: their weight is a share of the best advantage, which then is 0."""
    agent, _ = augmented(clone, demos_weight=10.0)
    before = [p.detach().clone() for p in agent.actor.parameters()]
    metrics = agent.learn(flown(agent, torch.full((FLOWN,), 3.0)), left=1.0)
    assert metrics["actor/step_length"] == 0.0
    assert all(torch.equal(a, b) for a, b in zip(before, agent.actor.parameters(), strict=True))


# -- bc_ppo


def anchored(**changes: Any) -> AnchoredActorCritic:
    """Return an agent that began with actions around 0.2, of a deviation of 0.5 before the tanh."""
    settings = BCPPO(**{"clip": 0.2, "target_kl": 0.0, **SMALL, **changes})
    return AnchoredActorCritic(settings, actor_at([0.2], log_std=math.log(0.5)), 2)


def without_gain() -> Advantages:
    """Steps of which none was better than another, so that nothing but the pull is left of the loss."""
    return judged_rows([0.3, -0.1, 0.5, 0.0], [0.0] * 4)


def pull(agent: AnchoredActorCritic) -> Tensor:
    part = without_gain()
    with torch.no_grad():
        now = agent.actor.judge(part.obs[:, None], part.raw)[0]
    return agent.actor_loss(part, now)[0]


def test_the_pull_to_the_prior_is_zero_there() -> None:
    agent = anchored(kl=3.0)
    result = pull(agent)
    slopes = torch.autograd.grad(result, list(agent.actor.parameters()), allow_unused=True)
    assert result.item() == pytest.approx(0.0, abs=1e-7)
    assert max(slope.abs().max().item() for slope in slopes if slope is not None) < 1e-6


@pytest.mark.parametrize("centre", [0.5, -0.3])
def test_elsewhere_the_pull_is_the_divergence_and_leads_back(centre: float) -> None:
    agent = anchored(kl=3.0)
    move_actor(agent.actor, [centre], math.log(0.8))
    result, moved = pull(agent), math.atanh(centre) - math.atanh(0.2)
    now, started = (torch.distributions.Normal(m, s) for m, s in ((moved, 0.8), (0.0, 0.5)))
    assert result.item() == pytest.approx(3.0 * torch.distributions.kl_divergence(now, started).item(), rel=1e-4)
    (slope,) = torch.autograd.grad(result, agent.actor.mean.bias)
    assert slope.item() == pytest.approx(3.0 * moved / 0.5**2, rel=1e-4), "against it, a step leads back"


def test_the_pull_fades_and_brings_back_what_nothing_holds() -> None:
    agent = anchored(kl=3.0, lr=0.01, rollout=Rollout(steps=128, epochs=20, batch_size=4))
    move_actor(agent.actor, [0.5], math.log(0.5))
    away = (math.atanh(0.5) - math.atanh(0.2)) ** 2 / (2 * 0.5**2)
    data = Judged(Advantages(*(column.detach() for column in without_gain())), 0.0)
    metrics = agent.learn(data, left=1.0, improve=False)
    assert metrics["actor/divergence"] == pytest.approx(away, rel=1e-4)
    for left in (1.0, 0.25, 0.0):
        agent.learn(data, left=left, improve=False)
        assert pull(agent).item() == pytest.approx(3.0 * left * away, abs=1e-5)
    assert agent.learn(data, left=1.0, improve=True)["actor/divergence"] < 0.5 * away
    assert anchored(kl=0.0).learn(data, left=1.0, improve=True)["actor/divergence"] == pytest.approx(0.0, abs=1e-6)
