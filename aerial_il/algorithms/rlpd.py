"""Reinforcement learning with prior data (RLPD): a soft actor-critic on demonstrations and its own flights alike.

Nothing is cloned and nothing is learned beforehand. One half of each minibatch are demonstrations, rewarded as the
agent is, and one half is what the agent flew (symmetric sampling). What makes that stable is in the critics: an
ensemble of E with LayerNorm, which bounds the values of actions that were never tried. It allows several updates for
each step. Each critic learns

    ``Q(s, a) = r + gamma * (min over Z of Q'(s', a') - alpha log pi(a' | s'))``,    a' ~ pi(. | s'),

with Z target critics sampled anew for each update; the actor minimises ``alpha log pi(a | s) - mean over E of Q(s, a)``
at every ``actor_every``-th update, and alpha is adjusted so that the entropy stays near its target. ``bc_weight``
pulls the actor to demonstrated actions besides, which the source does not.

An episode that ends by success goes on in an absorbing state with the reward of its end (``absorbing``): a reward for
every step would otherwise teach to stop just short of success. One that ends by a crash is terminal. With ``hindsight``
there is no absorbing state: flights are stored with other goals too, and critics bootstrap through success.

``demonstrations.control=random_actions`` puts as many transitions of random flights, with their rewards, in their
place.

Metrics: ``critic/loss``, ``critic/value``, ``critic/spread`` (standard deviation over the ensemble), ``actor/loss``,
``actor/entropy``, ``actor/alpha``; ``episode/return``, ``episode/length``, ``episode/success`` of the exploring policy;
``evaluate/<name>``; ``elapsed_s``.

Source: P. Ball, L. Smith, I. Kostrikov, S. Levine, "Efficient Online Reinforcement Learning with Offline Data", 2023,
algorithm 1; there 20 updates a step, here 4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor, nn

from aerial_il.algorithms.off_policy.agent import Agent
from aerial_il.algorithms.off_policy.critics import squared_error
from aerial_il.algorithms.off_policy.experience_replay import ExperienceReplay
from aerial_il.algorithms.off_policy.exploration import RandomActions
from aerial_il.algorithms.off_policy.hindsight import Hindsight
from aerial_il.algorithms.off_policy.loop import learn_off_policy
from aerial_il.algorithms.off_policy.problems import from_demonstrations
from aerial_il.algorithms.off_policy.settings import Critics, Replay
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.cloning import bc_loss
from aerial_il.algorithms.online.demonstrations import Demonstrations
from aerial_il.algorithms.online.problem import Given, Problem
from aerial_il.algorithms.online.replay_buffer import Batch, concatenated
from aerial_il.algorithms.online.rewards import Source
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.online.smoothness import Smoothness
from aerial_il.algorithms.run.cadence import Cadence
from aerial_il.algorithms.run.train_state import Follower, TrainState, adam
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.squashed_gaussian import SquashedGaussianNetwork


@dataclass(frozen=True, kw_only=True)
class RLPD(Algorithm):
    """Reinforcement learning with prior data (Ball et al. 2023, algorithm 1).

    Attributes:
        warmup: the first of those steps, flown at random before anything is learned.
    """

    name: ClassVar[str] = "rlpd"
    demonstrated: ClassVar[bool] = True

    steps: int = 300_000
    warmup: int = 5_000
    gamma: float = 0.99
    lr: float = 3e-4
    lr_floor: float = 1.0
    actor_every: int = 4
    alpha: float = 0.1
    entropy: float = -0.5
    subset: int = 2
    bc_weight: float = 0.0
    replay: Replay = Replay(capacity=1_000_000, batch_size=256, updates_per_step=4.0)
    critics: Critics = Critics(count=10, hidden=(256, 256), layer_norm=True, tau=0.005)
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

    def problem(self, given: Given) -> Problem:
        return from_demonstrations(self, given)

    def learn(self, run: OnlineRun) -> ChunkPolicy:
        absorbing, half = self.demonstrations.absorbing, self.replay.batch_size // 2
        agent = EnsembleActorCritic(self, run.build_actor(SquashedGaussianNetwork), run.sizes)
        demos = run.demos.buffer(run.interface, run.rng("demonstrations"), absorbing=absorbing, reward=None)
        flights = ExperienceReplay(run, self.replay.capacity, hindsight=self.hindsight, absorbing=absorbing)
        pilot = RandomActions(run.sizes[1], run.rng("warm-up"))

        def update(improve: bool) -> dict[str, float]:
            del improve  # nothing is learned in the warm-up
            near = demos.sample(half)
            return agent.update(concatenated(near, flights.buffer.sample(self.replay.batch_size - half)), near)

        learn_off_policy(run, self, agent, flights, update, pilot=pilot, parts={"demonstrations": demos})
        return run.finish()


class EnsembleActorCritic(Agent[SquashedGaussianNetwork]):
    """Actor, an ensemble of critics, slowly following target networks and the temperature alpha."""

    def __init__(self, settings: RLPD, actor: SquashedGaussianNetwork, sizes: tuple[int, int]) -> None:
        self.settings, self.actor = settings, actor
        critics = settings.critics.build(sizes)
        temperature = nn.ParameterList([nn.Parameter(torch.tensor(math.log(settings.alpha)))])
        self.log_alpha, self.target_entropy = temperature[0], settings.entropy * sizes[1]
        improved = nn.ModuleDict({"policy": actor, "temperature": temperature})
        self.actor_state = TrainState(improved, adam(improved, settings.lr))
        self.critics = TrainState(critics, adam(critics, settings.lr))
        self.targets = Follower(critics)
        super().__init__({"actor": self.actor_state, "critics": self.critics}, {"targets": self.targets})

    def update(self, batch: Batch, demos: Batch) -> dict[str, float]:
        """Take one step of critics and targets and, where it is due, of actor and temperature.

        Args:
            batch: what they learn from. demos: the demonstrations in it.
        """
        loss, metrics = self.critic_loss(batch)
        self.critics.descend(loss)
        self.targets.follow(self.settings.critics.tau)
        self.updates += 1
        if self.updates % self.settings.actor_every == 0:
            loss, means = self.actor_and_alpha_loss(batch)
            self.actor_state.descend(loss + self._pull(batch, demos))
            metrics |= means
        return metrics

    def critic_loss(self, batch: Batch) -> tuple[Tensor, dict[str, float]]:
        """Return the squared Bellman error, summed over the critics."""
        return squared_error(self.critics.network, batch, self.bellman_targets(batch), spread=True)

    @torch.no_grad()
    def bellman_targets(self, batch: Batch) -> Tensor:
        """Return ``r + gamma * (min over Z of Q'(s', a') - alpha log pi(a' | s'))`` (B,)."""
        alive = 1.0 - batch.next_obs[:, -1]
        actions, _, log_prob = self.actor.sample(batch.next_obs[:, None, :-1])
        chosen = torch.randperm(self.settings.critics.count)[: self.settings.subset]
        values = self.targets.network(batch.next_obs, alive[:, None] * actions, chosen).min(0).values
        soft_values = values - self.log_alpha.exp() * alive * log_prob
        return batch.rewards + self.settings.gamma * batch.continues * soft_values

    def actor_and_alpha_loss(self, batch: Batch) -> tuple[Tensor, dict[str, float]]:
        """Return ``alpha log pi - mean Q`` plus alpha's own loss, without the absorbing state, where none is chosen.

        The first reaches the actor alone, the second alpha alone.
        """
        alive = 1.0 - batch.obs[:, -1]
        share, alpha = alive / alive.sum().clamp(min=1.0), self.log_alpha.detach().exp()
        actions, _, log_prob = self.actor.sample(batch.obs[:, None, :-1])
        values = self.critics.network(batch.obs, actions).mean(0)
        actor_loss = (share * (alpha * log_prob - values)).sum()
        entropy = -(share * log_prob.detach()).sum()
        alpha_loss = self.log_alpha * (entropy - self.target_entropy)
        means = {"actor/loss": actor_loss.item(), "actor/entropy": entropy.item(), "actor/alpha": alpha.item()}
        return actor_loss + alpha_loss, means

    def _pull(self, batch: Batch, demos: Batch) -> Tensor | float:
        """Return the loss that pulls the actor to demonstrated actions and holds it back from rough ones."""
        near = self.settings.bc_weight * bc_loss(self.actor, demos) if self.settings.bc_weight else 0.0
        return near + self.settings.smoothness.loss(self.actor, batch.obs[:, :-1], batch.next_obs[:, :-1])
