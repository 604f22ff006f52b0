"""The pieces of adversarial imitation are what their definitions say."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
import torch

from aerial_il.algorithms.adversarial.discriminator import (
    REWARDS,
    Discriminator,
    RunningNorm,
    cross_entropy,
    gradient_penalty,
)
from aerial_il.algorithms.adversarial.reward_net import RewardNet, Shape, with_action_noise
from aerial_il.algorithms.dac import DAC
from aerial_il.algorithms.off_policy.loop import lr_at
from aerial_il.algorithms.online.collector import Collector
from aerial_il.algorithms.online.demonstrations import check_same, read_transitions
from aerial_il.algorithms.online.interface import check_policy, decode, encode, encode_actions, fit_interface
from aerial_il.algorithms.online.moments import RunningMoments
from aerial_il.algorithms.online.replay_buffer import Batch, ReplayBuffer, rows_of, split
from aerial_il.algorithms.sac import SAC, SoftActorCritic
from aerial_il.core.errors import InvalidValueError, SimulationDivergedError
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.layout import Layout
from aerial_il.policies.squashed_gaussian import SquashedGaussian, log_density
from tests.algorithms import drift, point_mass
from tests.algorithms.drift import Drift
from tests.algorithms.made import made

POLICY = SquashedGaussian(hidden=(16,))


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


SHAPE: Shape = {
    "hidden": (32, 32),
    "spectral": False,
    "dropout": 0.0,
    "running_norm": False,
    "actions": True,
    "form": "airl",
}


def test_running_moments_are_those_of_everything_at_once() -> None:
    data = np.random.default_rng(0).normal(3.0, [0.1, 20.0, 0.0], (500, 3))
    moments, norm = RunningMoments(3), RunningNorm(3)
    for part in np.split(data, [1, 7, 300]):
        moments.add(part)
        norm.add(torch.from_numpy(part).float())
    np.testing.assert_allclose(moments.mean, data.mean(0))
    np.testing.assert_allclose(moments.deviation[:2], data.std(0)[:2])
    assert moments.deviation[2] == 3.0, "what is constant counts by its size"
    result = norm(torch.from_numpy(data).float()).numpy()
    np.testing.assert_allclose(result[:, :2], (data[:, :2] - data[:, :2].mean(0)) / data[:, :2].std(0), atol=2e-3)
    again = RunningMoments(3)
    again.restore(moments.snapshot())
    np.testing.assert_array_equal(again.normaliser().scale, moments.normaliser().scale)


def test_an_end_leads_to_an_absorbing_state_and_a_cut_does_not() -> None:
    obs, after = np.arange(6.0).reshape(3, 2), 10 + np.arange(6.0).reshape(3, 2)
    actions, rewards, terminal = np.full((3, 1), 0.5), np.array([1.0, 2.0, 3.0]), np.array([False, True, False])
    rows = torch.from_numpy(rows_of(obs, actions, rewards, after, terminal, absorbing=True))
    batch = split(rows, (3, 1, 3, 1, 1))
    assert len(rows) == 4
    np.testing.assert_array_equal(batch.obs[:3, :2], obs)
    np.testing.assert_array_equal(batch.next_obs, [[10, 11, 0], [12, 13, 1], [14, 15, 0], [12, 13, 1]])
    np.testing.assert_array_equal(batch.obs[3], [12, 13, 1])
    np.testing.assert_array_equal(batch.actions[:, 0], [0.5, 0.5, 0.5, 0])
    np.testing.assert_array_equal(batch.rewards, [1, 2, 3, 2])
    np.testing.assert_array_equal(batch.continues, 1)
    plain = split(torch.from_numpy(rows_of(obs, actions, rewards, after, terminal, absorbing=False)), (3, 1, 3, 1, 1))
    np.testing.assert_array_equal(plain.continues, [1, 0, 1])
    assert (plain.next_obs[:, -1] == 0).all()
    assert len(plain.obs) == 3


def test_the_buffer_drops_the_oldest_and_samples_on_when_resumed() -> None:
    memory = ReplayBuffer(5, 1, 1, np.random.default_rng(0))
    row = np.arange(8, dtype=np.float32)[:, None] * np.ones((1, 7), np.float32)
    memory.add(row[:4])
    memory.add(row[4:])
    assert len(memory) == 5
    assert set(memory.sample(200).rewards.tolist()) == {3, 4, 5, 6, 7}
    again = ReplayBuffer(5, 1, 1, np.random.default_rng(9))
    again.restore(memory.snapshot())
    assert torch.equal(again.sample(50).obs, memory.sample(50).obs)
    for one in (memory, again):
        one.add(-row[:2])
    assert torch.equal(again.sample(50).obs, memory.sample(50).obs)


@pytest.mark.parametrize("first", [0, 3])
def test_of_more_than_it_holds_the_buffer_keeps_the_newest(first: int) -> None:
    memory = ReplayBuffer(5, 1, 1, np.random.default_rng(0))
    row = np.arange(40, dtype=np.float32)[:, None] * np.ones((1, 7), np.float32)
    if first:
        memory.add(row[:first])
    memory.add(row[first:37])
    assert set(memory.sample(200).rewards.tolist()) == {32, 33, 34, 35, 36}
    memory.add(row[37:39])
    assert set(memory.sample(200).rewards.tolist()) == {34, 35, 36, 37, 38}, "the oldest went first"


def test_noise_on_demonstrated_actions_marks_no_absorbing_state() -> None:
    actor = POLICY.build(3, 2)
    obs, marks = torch.randn(4, 3), torch.tensor([[0.0], [1.0], [0.0], [1.0]])
    actions = torch.where(marks > 0.0, 0.0, 0.3 * torch.ones(4, 2))
    rows = torch.cat([obs, marks], dim=1)
    noisy = with_action_noise(Batch(rows, actions, rows, marks, marks), actor).actions
    assert (noisy[1::2] == 0.0).all()
    assert (noisy[::2] != actions[::2]).all()


def test_the_gradient_penalty_is_that_of_finite_differences() -> None:
    torch.manual_seed(0)
    score = Discriminator(3, (16,), spectral=False, dropout=0.0, running_norm=False).double()
    expert, agent, mix = torch.randn(5, 3).double(), torch.randn(5, 3).double(), torch.rand(5, 1).double()
    between, step = mix * expert + (1 - mix) * agent, 1e-5
    slopes = [(score(between + step * e) - score(between - step * e)) / (2 * step) for e in torch.eye(3).double()]
    wanted = ((torch.stack(slopes, 1).norm(dim=1) - 1) ** 2).mean()
    result = gradient_penalty(score, expert, agent, mix)
    assert result.item() == pytest.approx(wanted.item(), rel=1e-6)
    weight = score.layers[0].weight  # type: ignore[union-attr]
    (slope,) = torch.autograd.grad(result, weight)
    with torch.no_grad():
        weight[0, 0] += step
    more = gradient_penalty(score, expert, agent, mix).item()
    assert slope[0, 0].item() == pytest.approx((more - result.item()) / step, rel=1e-2, abs=1e-6)


def test_spectral_normalisation_bounds_the_slope() -> None:
    torch.manual_seed(0)
    score = Discriminator(4, (32, 32), spectral=True, dropout=0.0, running_norm=False)
    for _ in range(50):
        score(torch.randn(8, 4))
    a, b = torch.randn(2, 500, 4)
    rise = (score.eval()(a) - score(b)).abs() / (a - b).norm(dim=1)
    assert rise.max() <= 1.01


@pytest.mark.parametrize("changes", [{}, {"spectral": True}, {"dropout": 0.5}, {"running_norm": True}])
def test_a_discriminator_tells_two_clouds_apart(changes: dict[str, object]) -> None:
    torch.manual_seed(0)
    reward_net = RewardNet(2, 1, {**SHAPE, **changes}, lr=3e-3)  # type: ignore[typeddict-item]

    def cloud(centre: float, count: int = 64) -> Batch:
        obs = torch.cat([centre + torch.randn(count, 2), torch.zeros(count, 1)], dim=1)
        return Batch(obs, torch.zeros(count, 1), obs, torch.zeros(count), torch.ones(count))

    for _ in range(120):
        expert, agent = cloud(2.0), cloud(-2.0)
        loss, _ = cross_entropy(*reward_net.logits(expert, agent))
        reward_net.descend(loss + 0.1 * reward_net.gradient_penalty(expert, agent))
    expert, agent = cloud(2.0, 500), cloud(-2.0, 500)
    assert (reward_net.reward(expert.obs, expert.actions) > 0).float().mean() > 0.95
    assert (reward_net.reward(agent.obs, agent.actions) < 0).float().mean() > 0.95


def test_rewards_are_functions_of_the_discriminator() -> None:
    logit = torch.linspace(-5, 5, 11).double()
    share = torch.sigmoid(logit)
    torch.testing.assert_close(REWARDS["gail"](logit), -torch.log(1 - share))
    torch.testing.assert_close(REWARDS["airl"](logit), torch.log(share) - torch.log(1 - share))
    torch.testing.assert_close(REWARDS["exit"](logit), torch.log(share))


def test_the_density_of_squashed_actions_integrates_to_one() -> None:
    actions = torch.linspace(-1, 1, 200_001).double()[1:-1]
    for mean, log_std in ((0.0, 0.0), (1.0, -1.0), (-0.5, 0.5)):
        density = log_density(torch.atanh(actions), torch.tensor(mean), torch.tensor(log_std)).exp()
        assert torch.trapezoid(density, actions).item() == pytest.approx(1.0, abs=2e-3)


def test_samples_have_the_density_that_is_told() -> None:
    torch.manual_seed(0)
    network = POLICY.build(3, 2)
    obs = torch.randn(6, 1, 3)
    actions, raw, density = network.sample(obs)
    torch.testing.assert_close(actions, torch.tanh(raw))
    torch.testing.assert_close(log_density(raw, *network.gaussian(obs)).sum(-1), density)
    loss, _ = network.loss(obs, actions[:, None], torch.ones(6, 1))
    assert loss.item() == pytest.approx(-density.mean().item() / 2, rel=1e-3)


def test_a_restored_flight_goes_on_as_if_nothing_had_happened() -> None:
    """The environment cannot save its state: its actions are flown again."""
    rng, layout = np.random.default_rng(0), Layout.of(drift.SPEC, POLICY)
    flight = Collector(Drift(3), layout, seed=1)
    for _ in range(40):
        flight.step(rng.uniform(-1, 1, (3, 1)))
    saved, actions = flight.snapshot(), rng.uniform(-1, 1, (70, 3, 1))
    again = Collector(Drift(3), layout, seed=5)
    again.restore(saved)
    for action in actions:
        for mine, theirs in zip(flight.step(action), again.step(action), strict=True):
            np.testing.assert_array_equal(mine, theirs)
    assert flight.episode_means() == again.episode_means()


def test_an_environment_that_does_not_repeat_itself_is_told() -> None:
    layout = Layout.of(drift.SPEC, POLICY)
    flight = Collector(Drift(2), layout, seed=1)
    flight.step(np.full((2, 1), 0.1))
    env = Drift(2)
    again = Collector(env, layout, seed=1)
    env.step = lambda actions, mask=None: Drift.step(env, 2 * actions, mask)  # type: ignore[method-assign]
    with pytest.raises(InvalidValueError, match="does not repeat itself"):
        again.restore(flight.snapshot())


def test_an_action_that_is_not_finite_is_told_by_seed_and_step() -> None:
    flight = Collector(Drift(2), Layout.of(drift.SPEC, POLICY), seed=0)
    flight.step(np.zeros((2, 1)))
    with pytest.raises(SimulationDivergedError, match="step 1 of the episode with seed 1000001"):
        flight.step(np.array([[0.0], [np.nan]]))


def test_demonstrations_become_transitions() -> None:
    whole, arriving = drift.demonstrations(5), drift.demonstrations(5, ends_at_success=True)
    layout, result, data = read_transitions(whole, POLICY, trajectories=3, subsample=1, seed=0)
    assert len(result.frames) == 3 * drift.MAX_STEPS == data["transitions"]
    assert not result.terminal.any()
    _, ending, _ = read_transitions(arriving, POLICY, trajectories=None, subsample=1, seed=0)
    assert ending.terminal.sum() == 5
    _, few, _ = read_transitions(arriving, POLICY, trajectories=None, subsample=4, seed=0)
    assert few.terminal.sum() == 5, "thinned out, every end that was reached stays"
    _, thin, _ = read_transitions(whole, POLICY, trajectories=3, subsample=4, seed=0)
    assert len(thin.frames) < 0.4 * len(result.frames)
    np.testing.assert_array_equal(result.rewards, np.concatenate([demo.rewards for demo in whole[:3]]))
    for bounds in ("environment", "demonstrations"):
        interface = fit_interface(layout, result.frames, result.actions, policy=POLICY, bounds=bounds)
        actions = encode_actions(interface, result.actions, result.frames)
        assert np.abs(actions).max() <= 1
        np.testing.assert_allclose(decode(interface, actions, result.frames), result.actions, atol=1e-6)
    np.testing.assert_allclose(encode(interface, result.frames).std(0), 1.0, atol=1e-3)


def test_demonstrations_pay_what_they_were_paid_or_what_is_said() -> None:
    layout, result, data = read_transitions(drift.demonstrations(5), POLICY, trajectories=None, subsample=1, seed=0)
    interface = fit_interface(layout, result.frames, result.actions, policy=POLICY, bounds="environment")
    own, said = (result.encoded(interface, absorbing=False, reward=reward)[:, -2] for reward in (None, 0.5))
    np.testing.assert_allclose(own, result.rewards, rtol=1e-6)
    assert result.rewards.std() > 0.01
    assert (said == 0.5).all()
    other = result._replace(rewards=result.rewards + 1.0)
    assert other.digest(rewarded=False) == result.digest(rewarded=False) == data["digest"]
    assert other.digest(rewarded=True) != result.digest(rewarded=True)


def test_what_cannot_be_imitated_is_refused() -> None:
    for wrong in (0, -1):
        with pytest.raises(InvalidValueError, match=f"trajectories is {wrong}; it must be positive"):
            made(DAC, {"trajectories": wrong})
    demos = drift.demonstrations(2)
    with pytest.raises(InvalidValueError, match="trajectories is 3; the dataset has 2"):
        read_transitions(demos, POLICY, trajectories=3, subsample=1, seed=0)
    with pytest.raises(InvalidValueError, match="choose policy=squashed_gaussian"):
        check_policy(MLP())
    with pytest.raises(InvalidValueError, match="got history=2 and chunk=1"):
        check_policy(replace(POLICY, history=2))
    with pytest.raises(InvalidValueError, match="another environment: robot: 'mass' != 'point'; task: 'go' != 'pick'"):
        check_same(drift.SPEC, point_mass.SPEC)
    anchored = replace(POLICY, anchor="ee_pos", masked_fields=())
    layout, result, _ = read_transitions(point_mass.demonstrations(2), anchored, trajectories=None, subsample=1, seed=0)
    with pytest.raises(InvalidValueError, match="bounds=demonstrations"):
        fit_interface(layout, result.frames, result.actions, policy=anchored, bounds="environment")
    turned = replace(POLICY, anchor="ee_pos", relative=True, masked_fields=("ee_*",))
    layout, result, _ = read_transitions(point_mass.demonstrations(2), turned, trajectories=None, subsample=1, seed=0)
    with pytest.raises(InvalidValueError, match=r"relative to the end effector.*bounds=demonstrations"):
        fit_interface(layout, result.frames, result.actions, policy=turned, bounds="environment")
    interface = fit_interface(layout, result.frames, result.actions, policy=turned, bounds="demonstrations")
    actions = encode_actions(interface, result.actions, result.frames)
    np.testing.assert_allclose(decode(interface, actions, result.frames), result.actions, atol=1e-5)


def test_what_the_expert_meant_can_stand_for_what_was_executed() -> None:
    (demo,) = drift.demonstrations(1)
    meant = demo.executed_actions + 0.25
    meant[3:5] = np.nan  # nobody was asked
    perturbed = replace(demo, expert_actions=meant)
    for labels, wanted in (
        ("executed", demo.executed_actions),
        ("expert", np.where(np.isnan(meant), demo.executed_actions, meant)),
    ):
        _, result, _ = read_transitions([perturbed], POLICY, trajectories=None, subsample=1, labels=labels, seed=0)
        np.testing.assert_array_equal(result.actions, wanted)


def test_demonstrations_are_blurred_as_the_agent_explores() -> None:
    torch.manual_seed(0)
    actor = replace(POLICY, spread="free", log_std=-2.0).build(1, 1)
    shown = Batch(
        torch.zeros(4000, 2), torch.full((4000, 1), 0.3), torch.zeros(4000, 2), torch.zeros(4000), torch.ones(4000)
    )
    raw = torch.atanh(with_action_noise(shown, actor).actions)
    assert abs(float(raw.mean()) - np.arctanh(0.3)) < 0.01
    assert abs(float(raw.std()) - np.exp(-2.0)) < 0.01


def test_an_agent_learns_at_the_rate_that_is_left() -> None:
    settings = made(SAC, {"lr": 1e-3, "lr_floor": 0.2, "critic_hidden": (8,)})
    assert [lr_at(settings, left) for left in (1.0, 0.5, 0.0)] == pytest.approx([1e-3, 6e-4, 2e-4])
    torch.manual_seed(0)
    agent = SoftActorCritic(settings, POLICY.build(1, 1), (1, 1))
    batch = Batch(torch.zeros(16, 2), torch.rand(16, 1), torch.zeros(16, 2), torch.ones(16), torch.ones(16))

    def moved_at(rate: float) -> bool:
        before = [weights.clone() for weights in agent.actor.parameters()]
        agent.set_lr(rate)
        for _ in range(settings.actor_every):
            agent.update(batch)
        return any(not torch.equal(a, b) for a, b in zip(before, agent.actor.parameters(), strict=True))

    assert moved_at(1e-3)
    assert not moved_at(0.0)
