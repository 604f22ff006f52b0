"""Advantage-weighted actor-critic (AWAC): imitate what was better than usual, from a dataset first, then from flights.

Two critics learn ``Q(s, a) = r + gamma * min Q'(s', a')`` with a' sampled from the actor. The actor never maximises
them, which would lead it to actions that were never tried; it raises the likelihood of actions in the minibatch,

    ``max E log pi(a | s) * min(exp(A(s, a) / temperature), weight_limit)``,    A(s, a) = min Q(s, a) - min Q(s, a'),

a' again sampled from it. After ``offline_steps`` gradient steps on the dataset it flies, and learns from both in the
same way. With an infinite temperature it is behavioural cloning. ``failures=true`` adds failed episodes.

Metrics, with negative steps before the first flight: ``critic/loss``, ``critic/value``, ``actor/loss``,
``actor/advantage``, ``actor/weight``; ``episode/return``, ``episode/length``, ``episode/success`` of the exploring
policy; ``evaluate/<name>``, at step 0 of the policy that begins to fly; ``elapsed_s``.

Source: A. Nair, A. Gupta, M. Dalal, S. Levine, "AWAC: Accelerating Online Reinforcement Learning with Offline
Datasets", 2020, algorithm 1; weights are limited as in IQL, where the source divides them by their sum.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from aerial_il.algorithms.rl.agent import Agent, sampled
from aerial_il.algorithms.rl.critics import Target
from aerial_il.algorithms.rl.off_policy import RandomActions
from aerial_il.algorithms.rl.offline import OfflineFirst
from aerial_il.algorithms.rl.online_run import OnlineRun
from aerial_il.algorithms.rl.replay.experience_replay import ExperienceReplay
from aerial_il.algorithms.rl.replay.replay_buffer import Batch
from aerial_il.algorithms.run.checks import require_positive
from aerial_il.algorithms.run.train_state import TrainState, adam
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.critics import Critics
from aerial_il.policies.squashed_gaussian import SquashedGaussian, unsquashed


@dataclass(frozen=True, kw_only=True)
class AdvantageWeightedLearning(OfflineFirst):
    """Settings of a run, beside those of :class:`OfflineFirst`.

    Attributes:
        temperature: of the weights, in the unit of returns: small ones imitate the best actions alone.
        weight_limit: what no weight exceeds.
    """

    name: ClassVar[str] = "awac"

    temperature: float = 0.3
    weight_limit: float = 100.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "temperature", "weight_limit")

    def learn(self, run: OnlineRun) -> ChunkPolicy:
        agent = AdvantageWeightedAgent(self, run.build_actor(SquashedGaussian), run.sizes)
        blind = RandomActions(run.sizes[1], run.rng("warm-up"))
        demos = run.demos.buffer(run.interface, run.rng("demonstrations"), absorbing=self.absorbing, reward=None)
        replay = ExperienceReplay(run, self.buffer_size, hindsight=self.hindsight, absorbing=self.absorbing)
        run.begin(agent.actor, {"agent": agent, "demonstrations": demos, **replay.parts, "random_actions": blind})

        for _ in run.offline(self.offline_steps):
            run.log(agent.update(demos.sample(self.batch_size)))

        while run.goes_on():
            warming_up = run.collector.steps < self.warmup
            replay.step(agent if self.offline_steps or not warming_up else blind)

            agent.set_lr(self.lr_at(run.left))
            for _ in range(0 if warming_up else run.updates_due(self.utd_ratio)):
                run.log(agent.update(self.minibatch(demos, replay.buffer)))
            run.end_turn()

        return run.finish()


class AdvantageWeightedAgent(Agent):
    """Actor and two critics with slowly following target networks.

    Args:
        settings: of the algorithm. actor: the policy's network. sizes: elements of an observation and of an action.
    """

    def __init__(self, settings: AdvantageWeightedLearning, actor: SquashedGaussian, sizes: tuple[int, int]) -> None:
        self.settings, self.actor = settings, actor
        critics = settings.build_critics(sizes[0] + 1 + sizes[1])
        self._actor_state = TrainState(actor, adam(actor, settings.lr))
        self._critics = TrainState(critics, adam(critics, settings.lr))
        self._targets = Target(critics)
        super().__init__({"actor": self._actor_state, "critics": self._critics}, {"targets": self._targets})

    def explore(self, obs: np.ndarray) -> np.ndarray:
        """Sample actions (n, Da) for encoded observations (n, Do)."""
        return sampled(self.actor, obs)

    def update(self, batch: Batch) -> dict[str, float]:
        """Take one step of critics and targets and, where it is due, of the actor."""
        loss, metrics = self.critic_loss(batch)
        self._critics.descend(loss)
        self._targets.follow(self.settings.tau)
        self.updates += 1
        if self.updates % self.settings.actor_every == 0:
            loss, found = self.actor_loss(batch)
            smooth = self.settings.smoothness.loss(self.actor, batch.obs[:, :-1], batch.next_obs[:, :-1])
            self._actor_state.descend(loss + smooth)
            metrics |= found
        return metrics

    def critic_loss(self, batch: Batch) -> tuple[Tensor, dict[str, float]]:
        """Return the squared Bellman error of both critics."""
        with torch.no_grad():
            worth = self._worth(self._targets.network, batch.next_obs)
            targets = batch.rewards + self.settings.gamma * batch.continues * worth
        values = self._critics.network(batch.obs, batch.actions)
        loss = ((values - targets) ** 2).mean(1).sum()
        return loss, {"critic/loss": loss.item(), "critic/value": values.mean().item()}

    def actor_loss(self, batch: Batch) -> tuple[Tensor, dict[str, float]]:
        """Return ``-w log pi(a | s)`` without the absorbing state, where none is chosen."""
        alive = 1.0 - batch.obs[:, -1]
        weights, advantages = self.weights(batch)
        log_prob, _ = self.actor.judge(batch.obs[:, None, :-1], unsquashed(batch.actions))
        share = alive / alive.sum().clamp(min=1.0)
        loss = -(share * weights * log_prob).sum()
        found = {"actor/advantage": (share * advantages).sum().item(), "actor/weight": (share * weights).sum().item()}
        return loss, {"actor/loss": loss.item(), **found}

    @torch.no_grad()
    def weights(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Return the weight of each action of a minibatch, and its advantage, (B,) each."""
        usual = self._worth(self._critics.network, batch.obs)
        advantages = self._critics.network(batch.obs, batch.actions).min(0).values - usual
        weights = (advantages / self.settings.temperature).exp().clamp(max=self.settings.weight_limit)
        return weights, advantages

    def _worth(self, critics: Critics, obs: Tensor) -> Tensor:
        """Return the minimum of the ``critics`` for an action sampled from the actor, (B,)."""
        actions, _, _ = self.actor.sample(obs[:, None, :-1])
        return critics(obs, (1.0 - obs[:, -1:]) * actions).min(0).values
