"""Soft actor-critic: reinforcement learning from the environment's own reward, with a replay buffer.

Each turn of the loop takes one step in every world, stores it, and takes ``replay.updates_per_step`` gradient steps
for each environment step on minibatches of the buffer. Two critics learn

    ``Q(s, a) = r + gamma * (min Q'(s', a') - alpha log pi(a' | s'))``,    a' ~ pi(. | s'),

with slowly following target networks Q'; the actor minimises ``alpha log pi(a | s) - min Q(s, a)``, and alpha is
adjusted so that the entropy stays near its target. Actor and alpha are updated at every ``actor_every``-th step, which
saves a third of the time. The final policy is deterministic: the mean action. In the absorbing state of imitators
(:mod:`aerial_il.algorithms.online.replay_buffer`) there is one action, zero, and no entropy.

Metrics: ``critic/loss``, ``critic/value``, ``actor/loss``, ``actor/entropy``, ``actor/alpha``; ``episode/return``,
``episode/length``, ``episode/success`` of the exploring policy; ``evaluate/<name>``; ``elapsed_s``.

Source: T. Haarnoja et al., "Soft Actor-Critic Algorithms and Applications", 2018; defaults are its table 1.
I. Kostrikov et al., "Discriminator-Actor-Critic", 2019, for the absorbing state.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor, nn

from aerial_il.algorithms.off_policy.agent import Agent, squared_error
from aerial_il.algorithms.off_policy.loop import learn_from_reward
from aerial_il.algorithms.off_policy.problems import from_reward_or_prior
from aerial_il.algorithms.off_policy.settings import Critics, Hindsight, Replay
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.problem import Given, Problem, Source
from aerial_il.algorithms.online.replay_buffer import Batch, ReplayBuffer, bc_loss, bc_pretrain
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.online.smoothness import NO_SMOOTHNESS, Smoothness
from aerial_il.algorithms.run.cadence import Cadence
from aerial_il.algorithms.run.train_state import TrainState, adam
from aerial_il.policies.squashed_gaussian import SquashedGaussianNetwork


@dataclass(frozen=True, kw_only=True)
class SAC(Algorithm):
    """Soft actor-critic (Haarnoja et al. 2018, table 1)."""

    name: ClassVar[str] = "sac"

    steps: int = 300_000
    warmup: int = 5_000
    gamma: float = 0.99
    lr: float = 3e-4
    lr_floor: float = 1.0
    actor_every: int = 2
    alpha: float = 0.1
    entropy: float = -1.0
    replay: Replay = Replay(capacity=1_000_000, batch_size=256, updates_per_step=1.0)
    critics: Critics = Critics(count=2, hidden=(256, 256), layer_norm=False, tau=0.005)
    reward: Source = "environment"
    reward_patience: int = 200_000
    prior: str | None = None
    hindsight: Hindsight = Hindsight(goals=0, strategy="future", tolerance=1.0)
    smoothness: Smoothness = Smoothness(temporal=0.0, spatial=0.0, radius=0.05, rate_penalty=0.0, jerk_penalty=0.0)
    obs_norm: bool = False
    cadence: Cadence = Cadence(log_every=5_000, evaluate_every=0, checkpoint_every=50_000, keep_checkpoints=2)
    threads: int = 1

    def problem(self, given: Given) -> Problem:
        return from_reward_or_prior(self, given)

    def learn(self, run: OnlineRun) -> None:
        agent = SoftActorCritic(self, run.build_actor(SquashedGaussianNetwork), run.sizes)
        learn_from_reward(run, self, agent, agent.update)


class SoftActorCritic(Agent[SquashedGaussianNetwork]):
    """Actor, critics, slowly following target networks and the temperature alpha."""

    def __init__(self, settings: Algorithm, actor: SquashedGaussianNetwork, sizes: tuple[int, int]) -> None:
        super().__init__(settings, actor, sizes)
        self._smoothness: Smoothness = getattr(settings, "smoothness", NO_SMOOTHNESS)
        temperature = nn.ParameterList([nn.Parameter(torch.tensor(math.log(settings.alpha)))])
        self.log_alpha, self.target_entropy = temperature[0], settings.entropy * sizes[1]
        improved = nn.ModuleDict({"policy": actor, "temperature": temperature})
        self.actor_state: TrainState[nn.Module] = TrainState(improved, adam(improved, settings.lr))

    def bc_pretrain(self, demos: ReplayBuffer, steps: int) -> None:
        """Move the actor's mean action towards demonstrated ones in ``steps`` minibatches."""
        bc_pretrain(self.actor_state, self.actor, demos, steps=steps, batch_size=self.settings.replay.batch_size)

    def update(self, batch: Batch, *, demos: Batch | None = None, improve: bool = True) -> dict[str, float]:
        """Take one step of critics and targets and, where it is due, of actor and temperature.

        Args:
            batch: what all of them learn from.
            demos: demonstrations that the actor is pulled to as well, by the algorithm's ``bc_weight``.
            improve: whether the actor is updated; otherwise the critics alone learn the value of the policy.
        """
        critic_loss, metrics = self.critic_loss(batch)
        self.critics.descend(critic_loss)
        self.updates += 1
        if improve and self.updates % self.settings.actor_every == 0:
            pull = self.settings.bc_weight * bc_loss(self.actor, demos) if demos is not None else 0.0
            pull += self._smoothness.loss(self.actor, batch.obs[:, :-1], batch.next_obs[:, :-1])
            actor_loss, alpha_loss, means = self.actor_and_alpha_loss(batch)
            self.actor_state.descend(actor_loss + pull + alpha_loss)  # the first two reach the actor, the last alpha
            metrics |= means
        self.targets.follow(self.settings.critics.tau)
        return metrics

    def critic_loss(self, batch: Batch) -> tuple[Tensor, dict[str, float]]:
        """Return the squared Bellman error of both critics."""
        return squared_error(self.critics.network, batch, self.bellman_targets(batch))

    def target_values(self, obs: Tensor, actions: Tensor) -> Tensor:
        """Return what backups believe of actions, (B,): the smaller target critic."""
        return self.targets.network(obs, actions).min(0).values

    def actor_values(self, obs: Tensor, actions: Tensor) -> Tensor:
        """Return what the actor believes of actions, (B,): the smaller critic."""
        return self.critics.network(obs, actions).min(0).values

    @torch.no_grad()
    def bellman_targets(self, batch: Batch) -> Tensor:
        """Return ``r + gamma * (min Q'(s', a') - alpha log pi(a' | s'))`` (B,)."""
        alive = 1.0 - batch.next_obs[:, -1]
        actions, _, log_prob = self.actor.sample(batch.next_obs[:, None, :-1])
        values = self.target_values(batch.next_obs, alive[:, None] * actions)
        soft_values = values - self.log_alpha.exp() * alive * log_prob
        return batch.rewards + self.settings.gamma * batch.continues * soft_values

    def actor_and_alpha_loss(self, batch: Batch) -> tuple[Tensor, Tensor, dict[str, float]]:
        """Return ``alpha log pi - min Q`` and alpha's loss, both without the absorbing state, where none is chosen."""
        alive = 1.0 - batch.obs[:, -1]
        share, alpha = alive / alive.sum().clamp(min=1.0), self.log_alpha.detach().exp()
        actions, _, log_prob = self.actor.sample(batch.obs[:, None, :-1])
        values = self.actor_values(batch.obs, actions)
        actor_loss = (share * (alpha * log_prob - values)).sum()
        entropy = -(share * log_prob.detach()).sum()
        alpha_loss = self.log_alpha * (entropy - self.target_entropy)
        means = {"actor/loss": actor_loss.item(), "actor/entropy": entropy.item(), "actor/alpha": alpha.item()}
        return actor_loss, alpha_loss, means
