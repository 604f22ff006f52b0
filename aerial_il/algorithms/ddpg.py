"""Deep deterministic policy gradient (DDPG): an action-value critic, and a deterministic actor that ascends it.

Each turn takes one step in every world with the actor's action and Gaussian noise on it, stores it, and takes
``replay.updates_per_step`` gradient steps for each environment step on minibatches of the buffer:

    critic  ``Q(s, a) = r + gamma * Q'(s', mu'(s'))``,        actor  ``max Q(s, mu(s))``,

with slowly following target networks Q' and mu'. The actor exploits the critic's errors too, so that values are
overestimated, which ``td3`` mends. The actor is the mean action of a ``squashed_gaussian``, whose standard deviation is
not used.

Metrics: ``critic/loss``, ``critic/value``, ``actor/loss``; ``episode/return``, ``episode/length``, ``episode/success``
of the exploring policy; ``evaluate/<name>``; ``elapsed_s``.

Source: T. Lillicrap et al., "Continuous Control with Deep Reinforcement Learning", 2016, algorithm 1, whose noise is
correlated (``noise_correlation=0.85``); sizes and rates are those of "our DDPG" in S. Fujimoto et al., "Addressing
Function Approximation Error in Actor-Critic Methods", 2018.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from aerial_il.algorithms.off_policy.agent import Agent, ascent, squared_error
from aerial_il.algorithms.off_policy.exploration import ExplorationNoise
from aerial_il.algorithms.off_policy.loop import learn_from_reward
from aerial_il.algorithms.off_policy.problems import from_reward_or_prior
from aerial_il.algorithms.off_policy.settings import Critics, Hindsight, Replay
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.problem import Given, Problem, Source
from aerial_il.algorithms.online.replay_buffer import Batch
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.online.smoothness import Smoothness
from aerial_il.algorithms.run.cadence import Cadence
from aerial_il.algorithms.run.train_state import Follower
from aerial_il.policies.squashed_gaussian import SquashedGaussianNetwork


@dataclass(frozen=True, kw_only=True)
class DDPG(Algorithm):
    """Deep deterministic policy gradient (Lillicrap et al. 2016)."""

    name: ClassVar[str] = "ddpg"

    steps: int = 300_000
    warmup: int = 5_000
    gamma: float = 0.99
    lr: float = 1e-3
    lr_floor: float = 1.0
    actor_every: int = 1
    noise: float = 0.1
    noise_correlation: float = 0.0
    replay: Replay = Replay(capacity=1_000_000, batch_size=256, updates_per_step=1.0)
    critics: Critics = Critics(count=1, hidden=(256, 256), layer_norm=False, tau=0.005)
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
        agent = DeterministicAgent(self, run.build_actor(SquashedGaussianNetwork), run.sizes)
        learn_from_reward(run, self, agent, agent.update)


class DeterministicAgent(Agent[SquashedGaussianNetwork]):
    """Actor and critics, of which it has one, with slowly following target networks of all."""

    changing = (*Agent.changing, "actor_target", "_noise")

    def __init__(self, settings: Algorithm, actor: SquashedGaussianNetwork, sizes: tuple[int, int]) -> None:
        super().__init__(settings, actor, sizes)
        self.actor_target = Follower(actor)
        self._noise = ExplorationNoise(settings.noise, settings.noise_correlation)

    def explore(self, obs: np.ndarray) -> np.ndarray:
        """Return the actor's actions with noise (n, Da) for encoded observations (n, Do)."""
        return self._noise.explore(self.actor, obs)

    def update(self, batch: Batch, *, improve: bool = True) -> dict[str, float]:
        """Take one step of the critic, of the actor where it is due and to ``improve``, and of the targets."""
        critic_loss, metrics = self.critic_loss(batch)
        self.critics.descend(critic_loss)
        self.updates += 1
        if improve and self.updates % self.settings.actor_every == 0:
            actor_loss = self.actor_loss(batch)
            self.actor_state.descend(actor_loss)
            metrics["actor/loss"] = actor_loss.item()
        for target in (self.actor_target, self.targets):
            target.follow(self.settings.critics.tau)
        return metrics

    def critic_loss(self, batch: Batch) -> tuple[Tensor, dict[str, float]]:
        """Return the squared Bellman error of the critic."""
        return squared_error(self.critics.network, batch, self.bellman_targets(batch))

    @torch.no_grad()
    def bellman_targets(self, batch: Batch) -> Tensor:
        """Return ``r + gamma * Q'(s', mu'(s'))`` (B,)."""
        actions = self.actor_target.network(batch.next_obs[:, None, :-1])[:, 0]
        values = self.targets.network(batch.next_obs, actions)[0]
        return batch.rewards + self.settings.gamma * batch.continues * values

    def actor_loss(self, batch: Batch) -> Tensor:
        """Return ``-Q(s, mu(s))``, plus the smoothness loss."""
        return ascent(self.actor, self.critics.network, batch, self.settings.smoothness)
