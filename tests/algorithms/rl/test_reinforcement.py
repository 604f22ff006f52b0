"""What learners from a reward share: time limits, standardisation, smoothness, hindsight, a reward that never comes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml
from aerial_il.algorithms.rl.on_policy import OnPolicy

from aerial_il import algorithms
from aerial_il.algorithms.dqn import DQN, DeepQAgent, HeldChoices
from aerial_il.algorithms.npg import NPG, NaturalGradientAgent, conjugate_gradients, flat_gradient
from aerial_il.algorithms.off_policy.hindsight import Hindsight, Relabeller
from aerial_il.algorithms.online.collector import Collector, RewardScheme
from aerial_il.algorithms.online.interface import check_policy, encode, plain_interface, standardised
from aerial_il.algorithms.online.moments import RunningMoments
from aerial_il.algorithms.online.replay_buffer import Batch
from aerial_il.algorithms.online.smoothness import Smoothness
from aerial_il.algorithms.rl.reinforcement import RelabelledReinforcement
from aerial_il.algorithms.run.folder import CONFIG, read_metrics
from aerial_il.core.contracts import StepResult
from aerial_il.core.errors import InvalidValueError, NoRewardError
from aerial_il.core.goals import GoalColumns, GoalSpec
from aerial_il.policies import load_policy
from aerial_il.policies.categorical import Categorical
from aerial_il.policies.parts.layout import Layout
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from tests.algorithms.drift import EDGE, MAX_STEPS, SPEC, Drift
from tests.algorithms.sought import GOAL, Hidden, Sought, near

TAUGHT = {n: algorithms.get(n) for n in algorithms.names()}
REWARDED = [n for n, s in TAUGHT.items() if getattr(s, "rewarded", False) and not s.demonstrated]
RELABELLED = [n for n, s in TAUGHT.items() if issubclass(s, RelabelledReinforcement)]
POLICY = SquashedGaussian(hidden=(16,))
CHOICES = Categorical(hidden=(16,), choices="bounds")
SMALL: dict[str, Any] = {"warmup": 64, "batch_size": 32, "lr": 3e-3, "tau": 0.05, "critic_hidden": (16,)}
SMALL |= {"utd_ratio": 0.5, "actor_every": 1, "target_every": 1, "gamma": 0.9, "epochs": 4, "rollout": 80}
SMALL |= {"log_every": 80, "checkpoint_every": 0}


def short(name: str, **changes: Any) -> Any:
    cls: Any = algorithms.get(name)
    return cls(**{k: v for k, v in {**SMALL, **changes}.items() if k in cls.__dataclass_fields__})


def policy_of(settings: Any) -> Any:
    return POLICY if isinstance(POLICY, settings.trains) else CHOICES


def train(settings: Any, run: Path, env: Any, **options: Any) -> Any:
    return settings.train(None, policy_of(settings), env=env, run=run, seed=1, progress=False, **options)


class Paid(Drift):
    """Pays 1 for a step, and ends with it as it is told to."""

    terminal = False

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        result = super().step(0.0 * actions, mask)
        over = self.steps >= 1
        terminated, truncated = (over, ~over) if self.terminal else (~over, over)
        return replace(result, reward=np.ones(self.num_envs), terminated=terminated, truncated=truncated)


class Ends(Paid):
    terminal = True


@pytest.mark.parametrize("name", REWARDED)
def test_a_time_limit_is_no_end_of_what_is_to_come(tmp_path: Path, name: str) -> None:
    """One step of 1 is worth 1, steps without end 10 at gamma 0.9: only who goes on in the estimate tells the two."""
    entropy = {"alpha": 1e-6, "entropy": -20.0} if name == "sac" else {}
    often = {"rollout": 16, "lr": 1e-2, "steps": 800} if issubclass(algorithms.get(name), OnPolicy) else {}
    settings = short(name, **({"steps": 400} | entropy | often))
    values = {}
    for env in (Paid(8), Ends(8)):
        train(settings, tmp_path / type(env).__name__, env)
        values[type(env)] = read_metrics(tmp_path / type(env).__name__)[-1]["critic/value"]
    assert values[Paid] > 1.3 * values[Ends] > 0


@pytest.mark.parametrize("name", REWARDED)
def test_what_observations_were_standardised_by_is_saved_with_the_policy(tmp_path: Path, name: str) -> None:
    policy = train(short(name, steps=320, obs_norm=True), tmp_path, Drift(8))
    again = load_policy(tmp_path)
    assert (policy.interface.obs.scale != 1.0).all()
    np.testing.assert_array_equal(again.interface.obs.centre, policy.interface.obs.centre)
    obs = Drift(8).reset(0)
    np.testing.assert_array_equal(again.act(obs), policy.act(obs))


def test_what_was_remembered_in_the_warm_up_is_standardised_when_it_ends(tmp_path: Path) -> None:
    """Stopped after the warm-up and gone on with, the run ends with the same bytes: the moments are kept too."""
    settings = short("td3", steps=320, obs_norm=True, evaluate_every=160)
    whole = train(settings, tmp_path / "whole", Drift(8), evaluate=lambda policy, step: {})

    def stop(policy: Any, step: int) -> dict[str, float]:
        if step >= 160:
            raise KeyboardInterrupt
        return {}

    with pytest.raises(KeyboardInterrupt):
        train(settings, tmp_path / "run", Drift(8), evaluate=stop)
    again = train(settings, tmp_path / "run", Drift(8), evaluate=lambda policy, step: {})
    for mine, theirs in zip(again.network.parameters(), whole.network.parameters(), strict=True):
        assert torch.equal(mine, theirs)


class Silent(Drift):
    """Pays nothing, whatever is done."""

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        return replace(super().step(actions, mask), reward=np.zeros(self.num_envs))


@pytest.mark.parametrize("name", REWARDED)
def test_a_reward_that_never_comes_is_said_and_more_patience_goes_on(tmp_path: Path, name: str) -> None:
    settings = short(name, steps=480, reward_patience=160)
    with pytest.raises(NoRewardError, match=r"no reward but 0 has come.*reward_patience"):
        train(settings, tmp_path / "run", Silent(8))
    train(replace(settings, reward_patience=0), tmp_path / "run", Silent(8))
    assert read_metrics(tmp_path / "run")[-1]["step"] == 480


def test_a_constant_reward_tells_something_where_episodes_end_early(tmp_path: Path) -> None:
    """As in CartPole: each step is paid alike, and an episode that lives longer is paid more."""

    class Alive(Drift):
        def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
            return replace(super().step(actions, mask), reward=np.ones(self.num_envs))

    train(short("ddpg", steps=480, reward_patience=160), tmp_path, Alive(8))


def test_sparse_pays_success_alone() -> None:
    env = Drift(4)
    collector = Collector(env, Layout.of(SPEC, POLICY), seed=0, scheme=RewardScheme(sparse=True))
    steps = [collector.step(np.zeros((4, 1))) for _ in range(30)]
    assert {float(r) for step in steps for r in step.rewards} == {0.0, 1.0}
    assert all((step.rewards == step.success).all() for step in steps)


# -- smoothness


def test_rough_actions_cost_what_the_settings_say() -> None:
    smoothness = Smoothness(rate_penalty=2.0, jerk_penalty=3.0)
    collector = Collector(Drift(1), Layout.of(SPEC, POLICY), seed=0, scheme=RewardScheme(smoothness=smoothness))
    actions = [-0.5, 1.0, 1.0, -0.5]  # from -1 to 1: -1, 1, 1, -1
    costs = [collector.step(np.array([[action]])).penalties[0] for action in actions]
    assert costs == pytest.approx([0.0, 2.0 * 4.0, 0.0, 2.0 * 4.0 + 3.0 * 0.0 + 3.0 * (-1.0 - 3.0 + 3.0 + 1.0) ** 2])
    collector.step(np.array([[1.0]]))
    assert collector.step(np.array([[-0.5]])).penalties[0] == pytest.approx(8.0 + 3.0 * (-1 - 3 * 1 + 3 * -1 - 1) ** 2)


def test_a_new_episode_owes_nothing_to_the_last_action_of_the_one_before() -> None:
    scheme = RewardScheme(smoothness=Smoothness(rate_penalty=1.0))
    collector = Collector(Drift(1), Layout.of(SPEC, POLICY), seed=0, scheme=scheme)
    while not collector.step(np.array([[1.0]])).terminal[0]:
        pass
    assert collector.step(np.array([[-0.5]])).penalties[0] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ppo", "sac", "td3", "ddpg"])
def test_caps_makes_actors_that_answer_alike_to_what_follows(tmp_path: Path, name: str) -> None:
    """Beside the same training without: the same seeds, the same flights at first."""
    steps = 4_000 if name == "ppo" else 800
    rough, smooth = (
        train(short(name, steps=steps, smoothness=Smoothness(temporal=w, spatial=w)), tmp_path / str(w), Drift(8))
        for w in (0.0, 30.0)
    )
    assert roughness(smooth) < 0.5 * roughness(rough)


def roughness(policy: Any) -> float:
    env = Drift(64)
    obs, actions = env.reset(7), []
    policy.reset()
    for _ in range(5):
        actions.append(policy.act(obs))
        obs = env.step(actions[-1]).obs
    return float(np.abs(np.diff(actions, axis=0)).mean())


def test_an_actor_of_choices_cannot_be_regularised() -> None:
    network = CHOICES.build(2, 1)
    with pytest.raises(InvalidValueError, match=r"temporal is 1 .*rate_penalty"):
        Smoothness(temporal=1.0).loss(network, torch.zeros(3, 2), torch.zeros(3, 2))
    for asked in ("temporal", "spatial"):
        with pytest.raises(InvalidValueError, match=rf"{asked}( is)? 0\.5.*rate_penalty"):
            DQN(smoothness=Smoothness(**{asked: 0.5}))
    DQN(smoothness=Smoothness(rate_penalty=0.5))


# -- hindsight


def flown(strategy: str, goals: int) -> tuple[np.ndarray, ...]:
    """Return an episode of one world that never moves on purpose, as it is remembered once more."""
    env = Sought(1)
    columns = GoalColumns(GOAL, {"position": slice(0, 1), "goal": slice(1, 2)})
    settings = Hindsight(goals=goals, strategy=strategy)  # type: ignore[arg-type]
    relabeller = Relabeller(settings, columns, 1, np.random.default_rng(0))
    collector = Collector(env, Layout.of(SPEC, POLICY), seed=3)
    rng = np.random.default_rng(1)
    while True:
        actions = rng.uniform(-0.5, 0.5, (1, 1))
        if found := relabeller.add(collector.step(actions), actions):
            return found[0]


@pytest.mark.parametrize(("strategy", "goals"), [("future", 4), ("final", 1)])
def test_an_episode_is_remembered_with_goals_that_it_reached(strategy: str, goals: int) -> None:
    frames, actions, rewards, next_frames, lost = flown(strategy, goals)
    steps = len(frames) // goals
    np.testing.assert_array_equal(frames[:, 1], next_frames[:, 1])
    reached_later = next_frames[::goals, 0]
    for row in range(len(frames)):
        step = row // goals
        later = reached_later[step:] if strategy == "future" else reached_later[-1:]
        assert frames[row, 1] in later, "a goal that was reached from then on"
        assert rewards[row] == float(abs(next_frames[row, 0] - frames[row, 1]) <= 0.2)
    assert (rewards[-goals:] == 1.0).all(), "the last step reached where it led"
    assert not lost.any() or np.abs(reached_later[-1]) > EDGE
    assert len(actions) == steps * goals


def test_a_narrower_tolerance_pays_for_less_than_the_goal_lets_pass() -> None:
    columns = GoalColumns(GOAL, {"position": slice(0, 1), "goal": slice(1, 2)})
    frames = np.array([[0.05, 0.0], [0.15, 0.0], [0.25, 0.0]])
    np.testing.assert_array_equal(columns.rewards(frames), [1, 1, 0])
    np.testing.assert_array_equal(columns.rewards(frames, tolerance=0.5), [1, 0, 0])
    paid = []
    for tolerance in (1.0, 0.5):
        relabeller = Relabeller(Hindsight(goals=1, tolerance=tolerance), columns, 1, np.random.default_rng(0))
        collector, rewards = Collector(Sought(1), Layout.of(SPEC, POLICY), seed=3), 0.0
        rng = np.random.default_rng(1)
        for _ in range(60):
            actions = rng.uniform(-0.5, 0.5, (1, 1))
            step = collector.step(actions)
            rewards += float(relabeller.rewards(step).sum())
            rewards += sum(float(again[2].sum()) for again in relabeller.add(step, actions))
        paid.append(rewards)
    assert paid[0] > paid[1] > 0, "flights for their own goals and again for others"
    with pytest.raises(InvalidValueError, match="tolerance"):
        Hindsight(tolerance=1.5)
    own = GoalColumns(GoalSpec(("position",), ("goal",), near), {"position": slice(0, 1), "goal": slice(1, 2)})
    with pytest.raises(InvalidValueError, match=r"The rule of this goal is its own: tolerance is 0\.5"):
        own.rewards(frames, tolerance=0.5)


def test_offsets_follow_the_goal_that_is_put_in() -> None:
    spec = GoalSpec(("ee",), ("target",), lambda a, d: np.zeros(len(a)), offsets={"to_target": ("target", "ee")})
    columns = GoalColumns(spec, {"ee": slice(0, 2), "target": slice(2, 4), "to_target": slice(4, 6)})
    frames = np.array([[1.0, 2.0, 5.0, 5.0, 4.0, 3.0]])
    changed = columns.exchanged(frames, np.array([[1.5, 2.0]]))
    np.testing.assert_array_equal(changed, [[1.0, 2.0, 1.5, 2.0, 0.5, 0.0]])
    np.testing.assert_array_equal(frames[0, 2:4], [5.0, 5.0])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sac"])
def test_hindsight_learns_where_the_reward_hardly_comes(tmp_path: Path, name: str) -> None:
    """Beside the same training without, which finds nothing: success of the final policy."""
    rates = []
    for hindsight in (Hindsight(), Hindsight(goals=4)):
        settings = short(name, steps=2_400, batch_size=64, critic_hidden=(32, 32), hindsight=hindsight)
        rates.append(success_rate(train(settings, tmp_path / f"{hindsight.goals}", Hidden(8))))
    assert rates[0] < 0.1
    assert rates[1] > 0.7


def success_rate(policy: Any) -> float:
    env = Hidden(100)
    obs, done = env.reset(10_000), np.zeros(100, bool)
    policy.reset()
    for _ in range(MAX_STEPS):
        result = env.step(policy.act(obs))
        obs, done = result.obs, result.info["success"]
    return float(done.mean())


def test_with_hindsight_a_stopped_run_ends_with_the_same_bytes(tmp_path: Path) -> None:
    """Stopped in the middle of its episodes, whose beginnings must be kept too."""
    settings = short("ddpg", steps=240, warmup=40, evaluate_every=104, hindsight=Hindsight(goals=2))
    whole = train(settings, tmp_path / "whole", Sought(8), evaluate=lambda policy, step: {})

    def stop(policy: Any, step: int) -> dict[str, float]:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(settings, tmp_path / "run", Sought(8), evaluate=stop)
    again = train(settings, tmp_path / "run", Sought(8), evaluate=lambda policy, step: {})
    for mine, theirs in zip(again.network.parameters(), whole.network.parameters(), strict=True):
        assert torch.equal(mine, theirs)


def test_hindsight_is_refused_where_no_goal_is_told_or_seen(tmp_path: Path) -> None:
    settings = short("td3", steps=80, hindsight=Hindsight(goals=4))
    with pytest.raises(InvalidValueError, match="tells no goal"):
        train(settings, tmp_path / "none", Drift(8))
    blind = replace(POLICY, obs_names=("position",))
    with pytest.raises(InvalidValueError, match="goal is not shown"):
        settings.train(None, blind, env=Sought(8), run=tmp_path / "blind", progress=False)
    with pytest.raises(InvalidValueError, match="one final goal"):
        Hindsight(goals=4, strategy="final")


@pytest.mark.parametrize("name", RELABELLED)
def test_with_hindsight_another_reward_is_refused(name: str) -> None:
    with pytest.raises(InvalidValueError, match=r"goals is 4 and reward sparse.*reward=environment.*goals=0"):
        short(name, reward="sparse", hindsight=Hindsight(goals=4))
    short(name, reward="sparse", hindsight=Hindsight(goals=0))


# -- single parts


def test_natural_steps_are_those_of_the_fisher_information_written_out() -> None:
    torch.manual_seed(0)
    actor = SquashedGaussian(hidden=(3,), activation="tanh", spread="free").build(2, 1)
    settings = NPG(cg_damping=0.05, cg_iterations=50, step_size=1e-3)
    agent, obs = NaturalGradientAgent(settings, actor, 2), torch.randn(400, 2)
    raw = actor.sample(obs[:, None])[1].detach()
    weights, advantages = list(actor.parameters()), torch.randn(400)
    before = torch.cat([w.detach().reshape(-1) for w in weights])
    mean, log_std = actor.gaussian(obs[:, None])
    by_mean = torch.stack([flat_gradient(m, weights, keep=True) for m in mean[:, 0]])
    by_spread = flat_gradient(log_std[0, 0], weights, keep=True)
    deviation = log_std[0, 0].exp()
    fisher = by_mean.T @ by_mean / len(obs) / deviation**2 + 2.0 * torch.outer(by_spread, by_spread)
    damped = (fisher + 0.05 * torch.eye(len(fisher))).detach().double()
    gradient = flat_gradient((actor.judge(obs[:, None], raw)[0] * advantages).mean(), weights)
    natural = torch.linalg.solve(damped, gradient.double())
    wanted = natural * (settings.step_size / (gradient.double() @ natural)).sqrt()
    found = agent.improve(obs, obs, raw, advantages)
    moved = torch.cat([w.detach().reshape(-1) for w in weights]) - before
    assert torch.allclose(moved.double(), wanted, rtol=0.05, atol=0.02 * float(wanted.abs().max()))
    assert found["actor/approx_kl"] == pytest.approx(float(0.5 * wanted @ fisher.detach().double() @ wanted), rel=0.2)


def test_conjugate_gradients_solve() -> None:
    torch.manual_seed(0)
    root = torch.randn(5, 5)
    matrix, wanted = root @ root.T + torch.eye(5), torch.randn(5)
    found = conjugate_gradients(lambda v: matrix @ v, wanted, 20)
    assert torch.allclose(matrix @ found, wanted, atol=1e-3)


def test_choices_are_refused_where_actions_are_none() -> None:
    with pytest.raises(InvalidValueError, match="choices=bounds"):
        plain_interface(Layout.of(SPEC, CHOICES), Categorical())
    with pytest.raises(InvalidValueError, match="choose policy=categorical"):
        check_policy(POLICY, (Categorical,))


def test_a_run_that_was_begun_before_a_setting_was_there_goes_on(tmp_path: Path) -> None:
    settings = short("ppo", steps=320)
    train(settings, tmp_path, Drift(8))
    config = yaml.safe_load((tmp_path / CONFIG).read_text())
    for name in ("reward", "reward_patience", "smoothness"):
        del config["settings"][name]
    (tmp_path / CONFIG).write_text(yaml.safe_dump(config))
    train(settings, tmp_path, Drift(8))
    (tmp_path / "checkpoints").mkdir(exist_ok=True)
    with pytest.raises(InvalidValueError, match=r"settings\.reward"):
        train(replace(settings, reward="sparse"), tmp_path, Drift(8))


@pytest.mark.parametrize("worlds", [1, 3])
def test_updates_in_bouts_are_as_many_and_the_policy_stands_still_between_them(worlds: int) -> None:
    evenly, bouts = (DQN(utd_ratio=0.5, update_every=every) for every in (1, 24))
    turns = range(worlds, 241, worlds)
    assert sum(bouts.updates_due(steps, worlds) for steps in turns) == 120
    assert sum(evenly.updates_due(steps, worlds) for steps in turns) == 120
    assert {steps % 24 for steps in turns if bouts.updates_due(steps, worlds)} == {0}
    assert max(evenly.updates_due(steps, worlds) for steps in turns) == 1 + (worlds > 1)
    with pytest.raises(InvalidValueError, match="update_every"):
        DQN(update_every=0)


@pytest.mark.parametrize(("huber", "loss"), [(1.0, 49.5), (20.0, 800.0), (100.0, 1250.0)])
def test_an_end_that_costs_much_teaches_as_much_as_it_is_allowed_to(huber: float, loss: float) -> None:
    network = CHOICES.build(2, 1)
    for parameter in network.parameters():
        torch.nn.init.zeros_(parameter)
    end = Batch(
        obs=torch.zeros(4, 3), actions=torch.zeros(4, 1), rewards=torch.full((4,), -50.0),
        next_obs=torch.zeros(4, 3), continues=torch.zeros(4),
    )  # fmt: skip
    told = DeepQAgent(DQN(huber=huber), network).update(end)
    assert told["critic/loss"] == pytest.approx(loss)


def test_random_choices_are_held_and_the_best_ones_are_taken_in_between() -> None:
    torch.manual_seed(0)
    best, held = torch.full((500,), 7), HeldChoices(3, longest=20)
    taken = torch.stack([held.instead_of(best, 0.1) for _ in range(200)])
    random = taken != 7
    assert {*taken[random].tolist()} == {0, 1, 2}
    again = (taken[1:] == taken[:-1])[random[1:] & random[:-1]]
    assert 0.8 < again.double().mean() < 1.0, "held, and followed by another draw at times"
    assert 0.15 < random.double().mean() < 0.25, "a tenth of the free steps begin two of them on average"


def test_with_a_hold_of_one_step_choices_are_those_of_epsilon_greedy_and_a_hold_goes_on_after_a_break() -> None:
    torch.manual_seed(0)
    best, single = torch.full((20_000,), 7), HeldChoices(4, longest=1)
    for _ in range(2):
        assert (single.instead_of(best, 0.3) != 7).double().mean() == pytest.approx(0.3, abs=0.02)
    held, other = HeldChoices(4, longest=50), HeldChoices(4, longest=50)
    held.instead_of(best, 1.0)
    other.restore(held.snapshot())
    goes_on = held.instead_of(best, 0.0)
    assert 0.3 < (goes_on != 7).double().mean() < 0.45, "all but those of a single step, 1 / 1.625"
    assert torch.equal(other.instead_of(best, 0.0), goes_on)


def test_plain_observations_are_not_clipped_and_standardised_ones_are() -> None:
    interface = plain_interface(Layout(SPEC, ("position", "goal")), POLICY)
    far = np.array([[25.0, -300.0]])
    np.testing.assert_array_equal(encode(interface, far), far)
    moments = RunningMoments(2)
    moments.add(np.random.default_rng(0).normal(size=(100, 2)))
    np.testing.assert_allclose(encode(standardised(interface, moments), far), [[10.0, -10.0]])


@pytest.mark.parametrize("name", ["ppo", "sac"])
def test_a_short_run_in_which_no_reward_came_says_so_at_its_end(
    tmp_path: Path, name: str, caplog: pytest.LogCaptureFixture
) -> None:
    train(short(name, steps=160), tmp_path / "run", Silent(8))
    assert "In all 160 environment steps no reward but 0 has come: the policy has learned nothing." in caplog.text
    assert "algorithm=bc_ppo dataset=PATH" in caplog.text
    assert ("algorithm.hindsight.goals=4" in caplog.text) == (name == "sac"), "which has it"
    caplog.clear()
    train(short(name, steps=160), tmp_path / "rewarded", Drift(8))
    train(short(name, steps=160, reward_patience=0), tmp_path / "unasked", Silent(8))
    assert not caplog.text


def test_success_in_the_last_step_is_an_end_where_success_ends_an_episode() -> None:
    class Arriving(Drift):
        def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
            result, yes = super().step(actions, mask), np.ones(self.num_envs, bool)
            return replace(result, truncated=yes, info={**result.info, "success": yes})

    for ends in (True, False):
        collector = Collector(Arriving(4, ends_at_success=ends), Layout(SPEC, ("position", "goal")), seed=0)
        step = collector.step(np.zeros((4, 1)))
        assert (step.terminal == ends).all()
        assert (step.truncated != ends).all()
