"""Advantage-weighted actor-critic (AWAC): imitate what was better than average, in a dataset first, then in flights.

Two critics learn ``Q(s, a) = r + gamma * min Q'(s', a')`` with a' sampled from the actor. The actor never maximises
them, which would lead it to actions that were never tried; it raises the likelihood of actions in the minibatch,

    ``max E log pi(a | s) * min(exp(A(s, a) / temperature), weight_limit)``,    A(s, a) = min Q(s, a) - min Q(s, a'),

a' again sampled from it. After ``offline_steps`` gradient steps on the dataset it flies, and learns from both in the
same way. With an infinite temperature it is behavioural cloning. ``failures=true`` adds failed episodes.

Metrics, with negative steps before the first flight: ``critic/loss``, ``critic/value``, ``actor/loss``,
``actor/advantage``, ``actor/weight``; ``episode/return``, ``episode/length``, ``episode/success`` of the exploring
policy; ``evaluate/<name>``, at step 0 of the policy that starts to fly; ``elapsed_s``.

Source: A. Nair, A. Gupta, M. Dalal, S. Levine, "AWAC: Accelerating Online Reinforcement Learning with Offline
Datasets", 2020, algorithm 1; weights are limited as in IQL, where the source divides them by their sum.
"""

from dataclasses import dataclass
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
from aerial_il.core.checks import require_positive
from aerial_il.policies.parts.critics import Critics as CriticNetworks
from aerial_il.policies.squashed_gaussian import SquashedGaussianNetwork


@dataclass(frozen=True, kw_only=True)
class AWAC(Algorithm):
    """Advantage-weighted actor-critic (Nair et al. 2020, algorithm 1).

    Attributes:
        warmup: environment steps that the policy flies before it goes on learning; at random without offline_steps.
        temperature: of the weights, in the unit of returns: small ones imitate the best actions alone.
    """

    name: ClassVar[str] = "awac"
    demonstrated: ClassVar[bool] = True

    steps: int = 300_000
    offline_steps: int = 50_000
    warmup: int = 1_000
    gamma: float = 0.99
    lr: float = 3e-4
    lr_floor: float = 1.0
    actor_every: int = 1
    demos_share: float = 0.5
    temperature: float = 0.3
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
        require_positive(self, "temperature")

    def problem(self, given: Given) -> Problem:
        return from_demonstrations(self, given)

    def learn(self, run: OnlineRun) -> None:
        agent = AdvantageWeightedAgent(self, run.build_actor(SquashedGaussianNetwork), run.sizes)
        learn_offline_first(run, self, agent, agent.update)


class AdvantageWeightedAgent(Agent[SquashedGaussianNetwork]):
    """Actor and two critics with slowly following target networks."""

    def update(self, batch: Batch) -> dict[str, float]:
        """Take one step of critics and targets and, where it is due, of the actor."""
        loss, metrics = self.critic_loss(batch)
        self.critics.descend(loss)
        self.targets.follow(self.settings.critics.tau)
        self.updates += 1
        if self.updates % self.settings.actor_every == 0:
            loss, means = self.actor_loss(batch)
            smooth = self.settings.smoothness.loss(self.actor, batch.obs[:, :-1], batch.next_obs[:, :-1])
            self.actor_state.descend(loss + smooth)
            metrics |= means
        return metrics

    def critic_loss(self, batch: Batch) -> tuple[Tensor, dict[str, float]]:
        """Return the squared Bellman error of both critics."""
        with torch.no_grad():
            values = self._values(self.targets.network, batch.next_obs)
            targets = batch.rewards + self.settings.gamma * batch.continues * values
        return squared_error(self.critics.network, batch, targets)

    def actor_loss(self, batch: Batch) -> tuple[Tensor, dict[str, float]]:
        """Return ``-w log pi(a | s)`` without the absorbing state, where none is chosen."""
        return weighted_likelihood(self.actor, batch, *self.weights(batch))

    @torch.no_grad()
    def weights(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Return the weight of each action of a minibatch, and its advantage, (B,) each."""
        baseline = self._values(self.critics.network, batch.obs)
        advantages = self.critics.network(batch.obs, batch.actions).min(0).values - baseline
        weights = (advantages / self.settings.temperature).exp().clamp(max=self.settings.weight_limit)
        return weights, advantages

    def _values(self, critics: CriticNetworks, obs: Tensor) -> Tensor:
        """Return the minimum of the ``critics`` for an action sampled from the actor, (B,)."""
        actions, _, _ = self.actor.sample(obs[:, None, :-1])
        return critics(obs, (1.0 - obs[:, -1:]) * actions).min(0).values
