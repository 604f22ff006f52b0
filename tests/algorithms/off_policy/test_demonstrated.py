"""Learners from a reward that see demonstrations: what these are paid, and which of them are of no use."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from aerial_il import algorithms
from aerial_il.algorithms.online.collector import Collector, RewardScheme
from aerial_il.algorithms.online.demonstrations import read_transitions
from aerial_il.algorithms.online.interface import plain_interface
from aerial_il.algorithms.online.problem import reward_scheme
from aerial_il.algorithms.online.replay_buffer import Batch, rows_of
from aerial_il.algorithms.online.rewarded_demonstrations import with_rewards
from aerial_il.algorithms.online.smoothness import NO_SMOOTHNESS
from aerial_il.algorithms.rlpd import RLPD, EnsembleActorCritic
from aerial_il.core.errors import InvalidValueError, NoRewardError
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.critics import Critics
from aerial_il.policies.parts.layout import Layout
from tests.algorithms import small
from tests.algorithms.drift import SPEC, Drift, Silent, demonstrations, mean_reward
from tests.algorithms.made import made, names
from tests.algorithms.small import POLICY, train

SHOWN = [n for n in algorithms.names() if "demonstrations" in names(cls := algorithms.get(n)) and cls.rewarded]
each = pytest.mark.parametrize("name", SHOWN)


def short(name: str, **changes: Any) -> Any:
    cls: Any = algorithms.get(name)
    if getattr(cls(), "bc_pretrain_steps", 0):  # whose clone would take thousands, which nothing here asks about
        changes = {"bc_pretrain_steps": 50, **changes}
    return small.short(name, **{"steps": 320, "offline_steps": 40, **changes})


@each
def test_demonstrations_without_rewards_are_refused(tmp_path: Path, name: str) -> None:
    unpaid = [replace(d, rewards=0.0 * d.rewards) for d in demonstrations(4, ends_at_success=True)]
    env = Drift(8, ends_at_success=True)
    with pytest.raises(InvalidValueError, match=r"carry no reward.*algorithm\.reward=sparse"):
        train(short(name), tmp_path / "run", env, unpaid)
    train(short(name, reward="sparse"), tmp_path / "sparse", env, unpaid)


@each
def test_a_reward_that_is_no_number_is_refused(tmp_path: Path, name: str) -> None:
    demo, *others = demonstrations(4)
    rewards = demo.rewards.copy()
    rewards[3] = np.nan
    with pytest.raises(InvalidValueError, match="demo-0: the reward is not finite at step 3"):
        train(short(name), tmp_path, Drift(8), [replace(demo, rewards=rewards), *others])


@each
def test_demonstrations_longer_than_episodes_are_refused(tmp_path: Path, name: str) -> None:
    env = Drift(8)
    env.spec = replace(SPEC, max_steps=5)
    with pytest.raises(InvalidValueError, match=r"takes 12 steps, and episodes end after 5.*horizon=12"):
        train(short(name), tmp_path, env, demonstrations(4))


@each
def test_a_sparse_reward_needs_the_step_that_solved_the_task(tmp_path: Path, name: str) -> None:
    with pytest.raises(InvalidValueError, match="Success does not end an episode here"):
        train(short(name, reward="sparse"), tmp_path, Drift(8), demonstrations(4))
    with pytest.raises(InvalidValueError, match="demo-0 was not ended by its success"):
        train(short(name, reward="sparse"), tmp_path, Drift(8, ends_at_success=True), demonstrations(4))


@each
def test_a_sparse_reward_that_never_comes_is_reported(tmp_path: Path, name: str) -> None:
    """Of its own flights: what demonstrations were paid tells nothing of what the agent can reach."""
    env, demos = Silent(8, ends_at_success=True), demonstrations(4, ends_at_success=True)
    with pytest.raises(NoRewardError, match="reward_patience"):
        train(short(name, reward="sparse", reward_patience=160), tmp_path, env, demos)


@each
def test_to_be_paid_for_living_is_no_control_of_it(name: str) -> None:
    with pytest.raises(InvalidValueError, match="none or random_actions"):
        short(name, control="constant_reward")


def test_a_demonstration_is_paid_as_its_flight_would_be() -> None:
    """Step by step as by the collector, penalties too; sparse, for the step that ends it."""
    scheme = RewardScheme(smoothness=replace(NO_SMOOTHNESS, rate_penalty=0.3, jerk_penalty=0.1))
    demo = demonstrations(1)[0]
    collector = Collector(Flown(demo), Layout.of(SPEC, POLICY), seed=0, scheme=scheme)
    flown = [collector.step(action[None]) for action in demo.executed_actions]
    rewarded, whole = with_rewards(demo, scheme, Drift(1)), {"trajectories": None, "subsample": 1, "seed": 0}
    _, shown, _ = read_transitions([rewarded], POLICY, smoothness=scheme.smoothness, **whole)
    np.testing.assert_allclose(shown.rewards, [step.rewards[0] for step in flown])
    np.testing.assert_allclose(shown.penalties, [step.penalties[0] for step in flown])
    solved = demonstrations(1, ends_at_success=True)[0]
    sparse = with_rewards(solved, RewardScheme(sparse=True), Drift(1, ends_at_success=True)).rewards
    np.testing.assert_array_equal(sparse, np.arange(len(solved)) == len(solved) - 1)
    lost = replace(solved, success=False)
    assert not with_rewards(lost, RewardScheme(sparse=True), Drift(1, ends_at_success=True)).rewards.any()


class Flown(Drift):
    """Begins where a demonstration began."""

    def __init__(self, demo: Episode) -> None:
        super().__init__(1)
        self._demo = demo

    def reset(self, seeds: np.ndarray | int, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        super().reset(seeds, mask)
        self.position[0], self.goal[0] = self._demo.obs["position"][0], self._demo.obs["goal"][0]
        return self._observe()


# -- rlpd


@pytest.mark.slow
def test_rlpd_learns_more_than_from_random_flights(tmp_path: Path) -> None:
    """A few steps of its own, the same for both."""
    settings = {"steps": 640, "utd_ratio": 2.0, "actor_every": 2, "critics": 4, "entropy": -3.0}
    shown, random = (
        mean_reward(train(short("rlpd", control=control, **settings), tmp_path / control, Drift(8), demonstrations(20)))
        for control in ("none", "random_actions")
    )
    assert shown > random + 0.02


def batch(size: int = 7) -> Batch:
    torch.manual_seed(1)
    obs, action = torch.randn(size, 3), torch.rand(size, 1) * 2 - 1
    return Batch(obs, action, torch.randn(size, 3), torch.randn(size), torch.ones(size))


def test_a_backup_takes_the_least_of_the_critics_drawn() -> None:
    """With all of them drawn, that of all; alpha at nothing, so that only rewards and values are left."""
    settings = made(RLPD, {"critics": 3, "subset": 3, "critic_hidden": (8,), "alpha": 1e-9})
    agent, seen = EnsembleActorCritic(settings, POLICY.build(2, 1), (2, 1)), batch()
    seen = seen._replace(next_obs=torch.cat([seen.next_obs[:, :-1], torch.ones(7, 1)], 1))  # absorbing: action 0
    values = agent.targets.network(seen.next_obs, torch.zeros(7, 1))
    targets = agent.bellman_targets(seen)
    assert torch.allclose(targets, seen.rewards + settings.gamma * values.min(0).values, atol=1e-5)
    assert (values.max(0).values - values.min(0).values > 0).all(), "critics that are alike would tell nothing"


def test_critics_drawn_from_an_ensemble_are_those_of_all() -> None:
    critics, seen = Critics(4, (8, 8), 5, layer_norm=True), batch()
    drawn = critics(seen.obs, seen.actions, torch.tensor([4, 1]))
    assert torch.equal(drawn, critics(seen.obs, seen.actions)[[4, 1]])


def test_more_critics_are_drawn_than_there_are() -> None:
    with pytest.raises(InvalidValueError, match=r"between 1 and critics\.count, 2"):
        made(RLPD, {"critics": 2, "subset": 3})


def test_the_pull_moves_the_actor_to_demonstrated_actions() -> None:
    settings = made(RLPD, {"critics": 2, "critic_hidden": (8,), "actor_every": 1, "bc_weight": 1e4, "lr": 1e-2})
    agent, demos = EnsembleActorCritic(settings, POLICY.build(2, 1), (2, 1)), batch(32)
    demos = demos._replace(obs=torch.cat([demos.obs[:, :2], torch.zeros(32, 1)], 1), actions=torch.full((32, 1), 0.7))
    for _ in range(200):
        agent.update(demos, demos=demos)
    assert torch.allclose(agent.actor(demos.obs[:, None, :2])[:, 0], demos.actions, atol=0.1)


def test_in_an_absorbing_state_no_action_is_rough() -> None:
    """What the last step cost is not subtracted for ever."""
    ends, penalties = np.array([True, True]), np.array([0.3, 0.0])
    transitions = (np.zeros((2, 2)), np.zeros((2, 1)), 1.0 - penalties, np.ones((2, 2)), ends)
    rows = rows_of(*transitions, absorbing=True, penalties=penalties)
    np.testing.assert_allclose(rows[:, -2], [0.7, 1.0, 1.0, 1.0])


@each
def test_labels_of_an_expert_are_not_paired_with_rewards(name: str) -> None:
    with pytest.raises(InvalidValueError, match=r"labels=expert.*labels=executed"):
        short(name, labels="expert")


@each
def test_failures_alone_are_refused_with_a_sparse_reward(tmp_path: Path, name: str) -> None:
    failed = [replace(d, success=False) for d in demonstrations(4, ends_at_success=True)]
    with pytest.raises(InvalidValueError, match=r"None of the 4 demonstrations succeeds.*reward=environment"):
        train(short(name, reward="sparse", failures=True), tmp_path, Drift(8, ends_at_success=True), failed)


def test_a_crash_is_not_absorbed_where_rewards_teach() -> None:
    """Or what it brought last would be paid for ever."""
    demos = demonstrations(4, ends_at_success=True)
    crash = replace(demos[0], success=False, terminated=np.append(np.zeros(len(demos[0]) - 1, bool), True))
    _, result, _ = read_transitions([crash, *demos[1:]], POLICY, trajectories=None, subsample=1, failures=True, seed=0)
    assert result.terminal.sum() == 4
    assert result.success.sum() == 3
    interface = plain_interface(Layout(SPEC, ("position", "goal")), POLICY)
    for reward, ends in ((None, 3), (0.0, 4)):
        rows = result.encoded(interface, absorbing=True, reward=reward)
        assert len(rows) == len(result.frames) + ends, "one more row for each absorbing state"
        assert (rows[:, -1] == 0).sum() == 4 - ends, "nothing follows a crash"


def test_advice_names_what_the_algorithm_has() -> None:
    assert "algorithm.reward=environment" not in reward_scheme(short("ibrl")).advice
    assert "algorithm.reward=environment" in reward_scheme(short("ibrl", reward="sparse")).advice
    assert "hindsight.goals=4 algorithm.reward=environment" in reward_scheme(short("iql", reward="sparse")).advice
    assert "hindsight" not in reward_scheme(short("ibrl", reward="sparse")).advice
