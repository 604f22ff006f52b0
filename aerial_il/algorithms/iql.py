"""Implicit Q-learning (IQL): learn the value of the best of the tried actions, never evaluating others.

Three losses, each on transitions as they are in the minibatch:

    value   ``min E |tau - 1(u < 0)| u^2``,    u = min Q'(s, a) - V(s),
    critic  ``Q(s, a) = r + gamma * V(s')``,
    actor   ``max E log pi(a | s) * min(exp(beta u), weight_limit)``.

The first is an expectile: with ``expectile`` tau near 1, V is the value of the best of the actions tried in s, and no
action that was never tried is ever evaluated. Q' are the slowly following target networks of both critics. After
``offline_steps`` gradient steps on the dataset it flies, and learns from both in the same way. ``failures=true`` adds
failed episodes.

Metrics, with negative steps before the first flight: ``critic/loss``, ``critic/value``, ``value/loss``, ``actor/loss``,
``actor/advantage``, ``actor/weight``; ``episode/return``, ``episode/length``, ``episode/success`` of the exploring
policy; ``evaluate/<name>``, at step 0 of the policy that starts to fly; ``elapsed_s``.

Source: I. Kostrikov, A. Nair, S. Levine, "Offline Reinforcement Learning with Implicit Q-Learning", 2022, algorithm 1;
defaults are its own for locomotion (for Adroit it takes beta 0.5).
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import torch
from torch import Tensor

from aerial_il.algorithms.off_policy.agent import Agent, squared_error, weighted_likelihood
from aerial_il.algorithms.off_policy.loop import learn_offline_first
from aerial_il.algorithms.off_policy.problems import from_demonstrations
from aerial_il.algorithms.off_policy.settings import Critics, Hindsight, Replay
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.demonstrations import Demonstrations
from aerial_il.algorithms.online.problem import Given, Problem, Source
from aerial_il.algorithms.online.replay_buffer import Batch
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.online.smoothness import Smoothness
from aerial_il.algorithms.run.cadence import Cadence
from aerial_il.algorithms.run.train_state import TrainState, adam
from aerial_il.core.checks import require_positive, require_share
from aerial_il.policies.squashed_gaussian import SquashedGaussianNetwork


@dataclass(frozen=True, kw_only=True)
class IQL(Algorithm):
    """Implicit Q-learning (Kostrikov et al. 2022, algorithm 1).

    Attributes:
        warmup: environment steps that the policy flies before it goes on learning; at random without offline_steps.
        expectile: tau, 0.5 for the mean of the tried actions, near 1 for the best of them.
        beta: how sharply the actor prefers actions by their advantage; near 0 it is behavioural cloning.
    """

    name: ClassVar[str] = "iql"
    demonstrated: ClassVar[bool] = True

    steps: int = 300_000
    offline_steps: int = 50_000
    warmup: int = 1_000
    gamma: float = 0.99
    lr: float = 3e-4
    lr_floor: float = 1.0
    actor_every: int = 1
    demos_share: float = 0.5
    expectile: float = 0.7
    beta: float = 3.0
    weight_limit: float = 100.0
    replay: Replay = Replay(capacity=1_000_000, batch_size=256, updates_per_step=1.0)
    critics: Critics = Critics(count=2, hidden=(256, 256), layer_norm=False, tau=0.005)
    demonstrations: Demonstrations = Demonstrations(
        trajectories=None, subsample=1, bounds="environment", labels="executed", absorbing=True, control="none"
    )
    failures: bool = False
    reward: Source = "environment"
    reward_patience: int = 200_000
    hindsight: Hindsight = Hindsight(goals=0, strategy="future", tolerance=1.0)
    smoothness: Smoothness = Smoothness(temporal=0.0, spatial=0.0, radius=0.05, rate_penalty=0.0, jerk_penalty=0.0)
    cadence: Cadence = Cadence(log_every=5_000, evaluate_every=0, checkpoint_every=50_000, keep_checkpoints=2)
    threads: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        require_share(self, "expectile", below_one=True)
        require_positive(self, "expectile", "beta")

    def problem(self, given: Given) -> Problem:
        return from_demonstrations(self, given)

    def learn(self, run: OnlineRun) -> None:
        agent = ImplicitAgent(self, run.build_actor(SquashedGaussianNetwork), run.sizes)
        learn_offline_first(run, self, agent, agent.update)


class ImplicitAgent(Agent[SquashedGaussianNetwork]):
    """Actor, a state-value critic, and two action-value critics with slowly following target networks."""

    changing = (*Agent.changing, "value")

    def __init__(self, settings: IQL, actor: SquashedGaussianNetwork, sizes: tuple[int, int]) -> None:
        super().__init__(settings, actor, sizes)
        value = replace(settings.critics, count=1).build((sizes[0], 0))
        self.value = TrainState(value, adam(value, settings.lr))

    def update(self, batch: Batch) -> dict[str, float]:
        """Take one step of both kinds of critic and of the targets and, where it is due, of the actor."""
        with torch.no_grad():
            tried = self.targets.network(batch.obs, batch.actions).min(0).values
        advantages = tried - self.values(batch.obs)
        value_loss = expectile_loss(advantages, self.settings.expectile)
        critic_loss, metrics = self.critic_loss(batch)
        self.updates += 1
        if self.updates % self.settings.actor_every == 0:
            actor_loss, means = self.actor_loss(batch, advantages.detach())
            smooth = self.settings.smoothness.loss(self.actor, batch.obs[:, :-1], batch.next_obs[:, :-1])
            self.actor_state.descend(actor_loss + smooth)
            metrics |= means
        self.value.descend(value_loss)
        self.critics.descend(critic_loss)
        self.targets.follow(self.settings.critics.tau)
        return {"value/loss": value_loss.item(), **metrics}

    def critic_loss(self, batch: Batch) -> tuple[Tensor, dict[str, float]]:
        """Return the squared distance of both critics from ``r + gamma * V(s')``."""
        with torch.no_grad():
            targets = batch.rewards + self.settings.gamma * batch.continues * self.values(batch.next_obs)
        return squared_error(self.critics.network, batch, targets)

    def actor_loss(self, batch: Batch, advantages: Tensor) -> tuple[Tensor, dict[str, float]]:
        """Return ``-w log pi(a | s)`` without the absorbing state, where none is chosen."""
        weights = (self.settings.beta * advantages).exp().clamp(max=self.settings.weight_limit)
        return weighted_likelihood(self.actor, batch, weights, advantages)

    def values(self, obs: Tensor) -> Tensor:
        """Return ``V(s)`` (B,) for observations (B, Do + 1)."""
        return self.value.network(obs, obs[:, :0])[0]


def expectile_loss(errors: Tensor, expectile: float) -> Tensor:
    """Return ``mean |tau - 1(u < 0)| u^2`` of errors u (B,), least at the expectile tau of what they are errors of."""
    return ((expectile - (errors < 0).float()).abs() * errors**2).mean()
