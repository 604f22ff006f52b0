"""The equations of learners from a replay buffer, against numbers written by hand: targets and weights."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest
import torch

from aerial_il.algorithms.awac import AWAC, AdvantageWeightedAgent
from aerial_il.algorithms.ddpg import DDPG, DeterministicAgent
from aerial_il.algorithms.dqn import DQN, DeepQAgent
from aerial_il.algorithms.ibrl import IBRL, ProposedAgent
from aerial_il.algorithms.iql import IQL, ImplicitAgent, expectile_loss
from aerial_il.algorithms.online.replay_buffer import Batch
from aerial_il.algorithms.rlpd import RLPD, EnsembleActorCritic
from aerial_il.algorithms.run.train_state import Follower
from aerial_il.algorithms.sac import SAC, SoftActorCritic
from aerial_il.algorithms.td3 import TD3, TwinDelayedAgent
from aerial_il.policies.categorical import Categorical, CategoricalNetwork
from tests.algorithms.hand_set import actor_at, move_actor, set_critics, step_of
from tests.algorithms.made import made

ONE: dict[str, Any] = {"critic_hidden": (1,), "gamma": 0.9}

# Two critics that cross: (0.5 s + 2 a + 1) and (0.5 s - a + 2), s the first element of the observation, which is 1
# after a step. The smaller of them is the first one below a = 1/3, the second one above.
CROSSING = ([[0.5, 0.0, 0.0, 2.0], [0.5, 0.0, 0.0, -1.0]], [1.0, 2.0])


def crossing(action: float) -> float:
    """Return what the smaller of the two says after a step."""
    return 0.5 + min(2.0 * action + 1.0, 2.0 - action)


def mislead(agent: Any, centre: Sequence[float] = (-0.9,)) -> None:
    """Let what is trained, but no target, answer otherwise: backups that ask it are found out."""
    move_actor(agent.actor, centre)
    with torch.no_grad():
        for bias in agent.critics.network.biases:
            bias.add_(30.0)


def test_a_target_goes_its_share_of_the_way() -> None:
    network = torch.nn.Linear(1, 1)
    torch.nn.init.constant_(network.weight, 1.0)
    target = Follower(network)
    torch.nn.init.constant_(network.weight, 5.0)
    followed = []
    for _ in range(3):
        target.follow(0.25)
        followed.append(target.network.weight.item())
    assert followed == pytest.approx([2.0, 2.75, 3.3125])


# -- td3, ddpg and the smoothing of ibrl


def smoothed(name: str, centre: float, **changes: Any) -> Any:
    """Return an agent of either whose target actor answers ``centre``, and what its backups say of a step."""
    if name == "td3":
        agent: Any = TwinDelayedAgent(made(TD3, {**ONE, **changes}), actor_at([centre]), (2, 1))
        return agent, agent.bellman_targets
    settings = made(IBRL, {"critics": 2, "subset": 2, "critic_norm": False, **ONE, **changes})
    agent = ProposedAgent(settings, actor_at([centre]), (2, 1))
    return agent, lambda step: agent.bellman_targets(unproposed(step), listen=True)[0]


def unproposed(step: Batch) -> Batch:
    """Return a step after which the prior proposes nothing, so that the actor's own action is taken."""
    obs, next_obs = (
        torch.cat([seen[:, :2], torch.zeros(len(seen), 2), seen[:, 2:]], 1) for seen in (step.obs, step.next_obs)
    )
    return step._replace(obs=obs, next_obs=next_obs)


@pytest.mark.parametrize("name", ["td3", "ibrl"])
@pytest.mark.parametrize(("centre", "tried"), [(0.2, (-0.3, 0.7)), (0.8, (0.3, 1.0))])
def test_a_smoothed_backup_takes_the_smaller_critic(name: str, centre: float, tried: tuple[float, float]) -> None:
    """Noise without measure always goes as far as it may, up or down."""
    agent, targets = smoothed(name, centre, target_noise=1e6, noise_clip=0.5)
    set_critics(agent.targets.network, *CROSSING)
    mislead(agent)
    torch.manual_seed(0)
    result = targets(step_of([0.0] * 64, rewards=0.25))
    wanted = torch.tensor([0.25 + 0.9 * crossing(action) for action in tried])
    nearest = (result[:, None] - wanted).abs().min(1)
    assert nearest.values.max() < 1e-3
    assert set(nearest.indices.tolist()) == {0, 1}, "both ways"
    assert targets(step_of([0.0] * 4, rewards=0.25, continues=0.0)).tolist() == [0.25] * 4


@pytest.mark.parametrize("name", ["td3", "ibrl"])
def test_the_noise_of_the_target_has_its_deviation(name: str) -> None:
    agent, targets = smoothed(name, 0.3, target_noise=0.1, noise_clip=10.0)
    set_critics(agent.targets.network, [[0.0, 0.0, 0.0, 1.0]] * 2, [0.0, 0.0])
    torch.manual_seed(0)
    actions = targets(step_of([0.0] * 20_000)) / 0.9
    assert actions.mean().item() == pytest.approx(0.3, abs=0.005)
    assert actions.std().item() == pytest.approx(0.1, rel=0.03)


def test_actor_and_targets_of_td3_move_at_every_second_update() -> None:
    settings = made(TD3, {"actor_every": 2, "lr": 1e-2, "tau": 0.5, **ONE})
    agent = TwinDelayedAgent(settings, actor_at([0.2]), (2, 1))
    set_critics(agent.critics.network, *CROSSING)
    networks = (agent.critics, agent.actor_state, agent.actor_target, agent.targets)
    moved = []
    for _ in range(4):
        before = [torch.cat([p.detach().reshape(-1) for p in each.network.parameters()]) for each in networks]
        agent.update(step_of([0.1, -0.4], rewards=5.0))
        after = [torch.cat([p.detach().reshape(-1) for p in each.network.parameters()]) for each in networks]
        moved.append([not torch.equal(a, b) for a, b in zip(before, after, strict=True)])
    assert moved == [[True, False, False, False], [True] * 4] * 2


def test_the_actor_of_td3_climbs_the_first_critic() -> None:
    """The second one leads the other way, more steeply."""
    agent = TwinDelayedAgent(made(TD3, ONE), actor_at([0.2]), (2, 1))
    set_critics(agent.critics.network, [[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, -8.0]], [0.5, 3.0])
    loss = agent.actor_loss(step_of([0.0, 0.0]))
    assert loss.item() == pytest.approx(-0.7, abs=1e-4)
    (slope,) = torch.autograd.grad(loss, agent.actor.mean.bias)
    assert slope.item() == pytest.approx(-(1.0 - 0.2**2), abs=1e-4), "that of the tanh, downwards"


def test_the_critic_of_ddpg_learns_and_its_actor_climbs_it() -> None:
    agent = DeterministicAgent(made(DDPG, ONE), actor_at([0.2]), (2, 1))
    set_critics(agent.targets.network, [[0.5, 0.0, 0.0, 2.0]], [1.0])
    mislead(agent, [-0.5])
    set_critics(agent.critics.network, [[0.0, 0.0, 0.0, 1.0]], [0.0])
    loss, _ = agent.critic_loss(step_of([0.6, -0.4], rewards=0.25, continues=[1.0, 0.0]))
    target = 0.25 + 0.9 * (0.5 + 2.0 * 0.2 + 1.0)
    assert loss.item() == pytest.approx(((0.6 - target) ** 2 + (-0.4 - 0.25) ** 2) / 2, rel=1e-4)
    assert agent.actor_loss(step_of([0.0])).item() == pytest.approx(0.5, abs=1e-4), "less what Q says of -0.5"


# -- dqn


def choices(table: list[list[float]], *, dueling: bool = False) -> CategoricalNetwork:
    """Return a network whose scores of three choices are a row of ``table`` (2, 3), the one that an observation marks.

    The first row is for (1, 0), the second for (0, 1).
    """
    config = Categorical(hidden=(2,), activation="relu", choices="bounds", dueling=dueling)
    network = config.build(2, 1)
    tell_choices(network, table)
    return network


@torch.no_grad()
def tell_choices(network: CategoricalNetwork, table: list[list[float]]) -> None:
    layer = network.trunk[1]
    assert isinstance(layer, torch.nn.Linear)
    layer.weight.copy_(torch.eye(2))
    network.advantages.weight.copy_(torch.tensor(table).T)
    for bias in (layer.bias, network.advantages.bias):
        bias.zero_()


def decided() -> Batch:
    """One step from the first place to the second, and one that ends there, with the choice of 1."""
    first, second = (torch.tensor([[*place, 0.0]] * 2) for place in ((1.0, 0.0), (0.0, 1.0)))
    return Batch(first, torch.ones(2, 1), second, torch.tensor([0.5, 0.5]), torch.tensor([1.0, 0.0]))


@pytest.mark.parametrize(("double", "value"), [(True, 3.0), (False, 7.0)])
def test_in_double_dqn_the_network_chooses_and_its_target_judges(double: bool, value: float) -> None:
    network = choices([[90.0, 91.0, 92.0], [7.0, 3.0, 4.0]])
    agent = DeepQAgent(DQN(double=double, gamma=0.9), network)
    tell_choices(network, [[93.0, 94.0, 95.0], [1.0, 5.0, 2.0]])
    assert agent.bellman_targets(decided()).tolist() == pytest.approx([0.5 + 0.9 * value, 0.5])


def test_only_the_choice_that_was_taken_is_learned_about() -> None:
    network = choices([[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]])
    network.requires_grad_(False)
    network.advantages.weight.requires_grad_(True)
    agent = DeepQAgent(DQN(huber=100.0, lr=0.1, target_every=10), network)
    step = decided()._replace(continues=torch.zeros(2))
    assert agent.update(step) == {"critic/loss": pytest.approx(0.5 * 1.5**2), "critic/value": pytest.approx(2.0)}
    taken = int(network.nearest(step.actions)[0])
    assert taken == 1
    result = network.scores(step.obs[:1, None, :2])[0, 0].tolist()
    assert result == pytest.approx([1.0, 1.9, 3.0], abs=1e-4), "Adam's first step is its learning rate, to 0.5"


def test_dueling_values_are_those_of_state_plus_advantages() -> None:
    """Whatever is added to all advantages alike changes nothing."""
    network, seen = choices([[1.0, 2.0, 6.0], [0.0, 0.0, 0.0]], dueling=True), torch.tensor([[[1.0, 0.0]]])
    assert network.value is not None
    with torch.no_grad():
        network.value.weight.copy_(torch.tensor([[10.0, 0.0]]))
        network.value.bias.zero_()
        assert network.scores(seen)[0, 0].tolist() == pytest.approx([8.0, 9.0, 13.0])
        network.advantages.bias.add_(70.0)
        assert network.scores(seen)[0, 0].tolist() == pytest.approx([8.0, 9.0, 13.0], abs=1e-4)
        network.value.bias.add_(1.0)
        assert network.scores(seen)[0, 0].tolist() == pytest.approx([9.0, 10.0, 14.0], abs=1e-4)


# -- sac and rlpd


def soft(name: str, actor: Any = None, **changes: Any) -> Any:
    """Return an agent of either, with two critics and one action element unless there is an actor of more."""
    actor = actor or actor_at([0.0])
    sizes = (2, actor.shape[1])
    settings = {**ONE, "alpha": 0.3, "actor_every": 1, "lr": 1e-2, **changes}
    if name == "sac":
        return SoftActorCritic(made(SAC, settings), actor, sizes)
    return EnsembleActorCritic(made(RLPD, {"critics": 2, "subset": 2, "critic_norm": False, **settings}), actor, sizes)


def draws(agent: Any, monkeypatch: pytest.MonkeyPatch, actions: Sequence[float], log_prob: Sequence[float]) -> None:
    """Let the actor draw these actions, of these log densities, whatever it sees."""
    drawn, density = torch.tensor(actions)[:, None], torch.tensor(log_prob)
    monkeypatch.setattr(agent.actor, "sample", lambda obs: (drawn, torch.atanh(drawn), density))


both = pytest.mark.parametrize("name", ["sac", "rlpd"])


@both
def test_a_soft_backup_pays_for_entropy_except_when_absorbed(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    agent = soft(name)
    set_critics(agent.targets.network, *CROSSING)
    mislead(agent)
    draws(agent, monkeypatch, [-0.3, 0.7, 0.7], [-1.5, 0.8, 0.8])
    result = agent.bellman_targets(step_of([0.0] * 3, rewards=0.25, continues=[1.0, 1.0, 0.0]))
    wanted = [0.25 + 0.9 * (0.9 + 0.3 * 1.5), 0.25 + 0.9 * (1.8 - 0.3 * 0.8), 0.25]
    assert result.tolist() == pytest.approx(wanted, abs=1e-4)
    absorbed = agent.bellman_targets(step_of([0.0] * 3, rewards=0.25, absorbed=True))
    assert absorbed.tolist() == pytest.approx([0.25 + 0.9 * 1.5] * 3, abs=1e-4), "of an action of 0, without entropy"


def test_critics_are_drawn_anew_for_each_backup(monkeypatch: pytest.MonkeyPatch) -> None:
    agent = soft("rlpd", critics=3, subset=2)
    set_critics(agent.targets.network, [[0.0] * 4] * 3, [1.0, 5.0, 9.0])
    draws(agent, monkeypatch, [0.0], [0.0])
    torch.manual_seed(0)
    result = {round(agent.bellman_targets(step_of([0.0])).item(), 3) for _ in range(40)}
    assert result == {0.9, 4.5}, "of two drawn from 1, 5 and 9"


@both
def test_a_soft_actor_trades_entropy_for_value(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """``sac`` believes the smaller critic, ``rlpd`` their mean."""
    agent = soft(name)
    set_critics(agent.critics.network, *CROSSING)
    draws(agent, monkeypatch, [-0.3, 0.7], [-1.5, 0.8])
    loss = agent.actor_and_alpha_loss(step_of([0.0] * 2))[0]
    entropy = (1.5 - 0.8) / 2
    value = {"sac": (0.4 + 1.3) / 2, "rlpd": (0.4 + 2.3 + 2.4 + 1.3) / 4}[name]
    assert loss.item() == pytest.approx(-0.3 * entropy - value, abs=1e-4)


@both
@pytest.mark.parametrize(("log_std", "way"), [(-3.0, 1.0), (-2.17, -1.0)])
def test_the_temperature_moves_entropy_to_its_target(name: str, log_std: float, way: float) -> None:
    """Two action elements: the target is -2, the entropy near -3.2, or near -1.5, which is below one element's -1."""
    agent = soft(name, actor_at([0.0, 0.0], log_std), entropy=-1.0)
    set_critics(agent.critics.network, [[0.0] * 5] * 2, [0.0, 0.0])
    torch.manual_seed(0)
    step = step_of([0.0] * 500)
    step = step._replace(actions=torch.zeros(500, 2))
    metrics = agent.update(step)
    assert metrics["actor/entropy"] == pytest.approx(2 * (0.5 * math.log(2 * math.pi * math.e) + log_std), abs=0.15)
    assert metrics["actor/alpha"] == pytest.approx(0.3)
    change = agent.log_alpha.item() - math.log(0.3)
    assert change == pytest.approx(way * 1e-2, rel=0.01), "Adam's first step is its learning rate"


# -- awac and iql


def test_weights_of_awac_grow_with_the_advantage(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where s = 0 the smaller critic says min(2 a + 1, 2 - a); the actor's own action, 0, is worth 1."""
    settings = made(AWAC, {"temperature": 0.5, "weight_limit": 3.0, **ONE})
    agent = AdvantageWeightedAgent(settings, actor_at([0.0]), (2, 1))
    set_critics(agent.critics.network, *CROSSING)
    set_critics(agent.targets.network, [[9.0] * 4] * 2, [70.0, 70.0])
    draws(agent, monkeypatch, [0.0] * 5, [0.0] * 5)
    step = step_of([-0.4, 0.0, 0.2, 0.9, 0.5])
    weights, advantages = agent.weights(step)
    assert advantages.tolist() == pytest.approx([-0.8, 0.0, 0.4, 0.1, 0.5], abs=1e-4)
    exact = [math.exp(-1.6), 1.0, math.exp(0.8), math.exp(0.2), math.exp(1.0)]
    assert weights.tolist() == pytest.approx(exact, abs=1e-3)
    agent.settings = replace(settings, weight_limit=2.0)
    limited = agent.weights(step)[0].tolist()
    assert limited == pytest.approx([exact[0], 1.0, 2.0, exact[3], 2.0], abs=1e-3)


def test_critics_of_awac_learn_the_value_of_the_actors_action(monkeypatch: pytest.MonkeyPatch) -> None:
    agent = AdvantageWeightedAgent(made(AWAC, ONE), actor_at([0.0]), (2, 1))
    set_critics(agent.targets.network, *CROSSING)
    set_critics(agent.critics.network, [[0.0] * 4] * 2, [1.0, 2.0])
    draws(agent, monkeypatch, [0.7, 0.7], [5.0, 5.0])
    loss, _ = agent.critic_loss(step_of([0.0, 0.0], rewards=0.25, continues=[1.0, 0.0]))
    target = 0.25 + 0.9 * crossing(0.7)
    errors = [(value - wanted) ** 2 for value in (1.0, 2.0) for wanted in (target, 0.25)]
    assert loss.item() == pytest.approx(sum(errors) / 2, rel=1e-4)


@pytest.mark.parametrize("name", ["awac", "iql"])
def test_the_likelihood_of_tried_actions_counts_by_their_weights(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Advantages of 0.4 and -0.8, at a temperature of 0.5: weights e^0.8 and e^-1.6."""
    actor, step = actor_at([0.3], log_std=-0.5), step_of([0.2, -0.4])
    agent: Any
    if name == "awac":
        agent = AdvantageWeightedAgent(made(AWAC, {"temperature": 0.5, **ONE}), actor, (2, 1))
        set_critics(agent.critics.network, *CROSSING)
        draws(agent, monkeypatch, [0.0] * 2, [0.0] * 2)
        loss, result = agent.actor_loss(step)
    else:
        agent = ImplicitAgent(made(IQL, {"beta": 2.0, **ONE}), actor, (2, 1))
        loss, result = agent.actor_loss(step, torch.tensor([0.4, -0.8]))
    weights, deviation = (math.exp(0.8), math.exp(-1.6)), math.exp(-0.5)
    likely = [
        -0.5 * ((math.atanh(a) - math.atanh(0.3)) / deviation) ** 2
        - math.log(deviation * math.sqrt(2 * math.pi))
        - math.log(1 - a**2)
        for a in (0.2, -0.4)
    ]
    assert loss.item() == pytest.approx(-sum(w * p for w, p in zip(weights, likely, strict=True)) / 2, rel=1e-3)
    assert result["actor/weight"] == pytest.approx(sum(weights) / 2, rel=1e-3)
    assert result["actor/advantage"] == pytest.approx(-0.2, abs=1e-4)


def implicit(**changes: Any) -> ImplicitAgent:
    """Return an agent whose V is 1 + 3 s, and whose target critics say what two that cross do."""
    agent = ImplicitAgent(made(IQL, {**ONE, **changes}), actor_at([-0.9]), (2, 1))
    set_critics(agent.targets.network, *CROSSING)
    set_critics(agent.critics.network, [[0.0] * 4] * 2, [70.0, 71.0])
    set_critics(agent.value.network, [[3.0, 0.0, 0.0]], [1.0])
    return agent


def test_weights_of_iql_grow_with_the_advantage() -> None:
    """V is 1 where s = 0; the smaller target critic says 0.2, 1, 1.4 and 1.1 of what was tried there."""
    step, advantages = step_of([-0.4, 0.0, 0.2, 0.9]), [-0.8, 0.0, 0.4, 0.1]
    metrics = implicit(beta=2.0, expectile=0.7).update(step)
    assert metrics["actor/advantage"] == pytest.approx(sum(advantages) / 4, abs=1e-4)
    weights = [math.exp(2.0 * advantage) for advantage in advantages]
    assert metrics["actor/weight"] == pytest.approx(sum(weights) / 4, rel=1e-3)
    squares = [(0.7 if advantage > 0 else 0.3) * advantage**2 for advantage in advantages]
    assert metrics["value/loss"] == pytest.approx(sum(squares) / 4, rel=1e-3)
    limited = implicit(beta=2.0, weight_limit=1.5).update(step)["actor/weight"]
    assert limited == pytest.approx((weights[0] + 1.0 + 1.5 + weights[3]) / 4, rel=1e-3)


def test_the_critics_of_iql_learn_the_value_of_the_next_state() -> None:
    agent = implicit()
    loss, _ = agent.critic_loss(step_of([0.0, 0.0], rewards=0.25, continues=[1.0, 0.0]))
    errors = [(value - wanted) ** 2 for value in (70.0, 71.0) for wanted in (0.25 + 0.9 * 4.0, 0.25)]
    assert loss.item() == pytest.approx(sum(errors) / 2, rel=1e-4)


@pytest.mark.parametrize(("expectile", "wanted"), [(0.5, 7.0), (0.7, 6.2), (0.9, 5.4)])
def test_an_expectile_weighs_errors_above_and_below(expectile: float, wanted: float) -> None:
    """Of errors 2, -3 and 1: 4 tau + 9 (1 - tau) + tau, over three."""
    assert expectile_loss(torch.tensor([2.0, -3.0, 1.0]), expectile).item() == pytest.approx(wanted / 3)
