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
policy; ``evaluate/<name>``, at step 0 of the policy that begins to fly; ``elapsed_s``.

Source: I. Kostrikov, A. Nair, S. Levine, "Offline Reinforcement Learning with Implicit Q-Learning", 2022, algorithm 1;
defaults are its own for locomotion (for Adroit it takes beta 0.5).
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
from aerial_il.algorithms.run.checks import require_positive, require_share
from aerial_il.algorithms.run.train_state import TrainState, adam
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.squashed_gaussian import SquashedGaussian, unsquashed


@dataclass(frozen=True, kw_only=True)
class ImplicitQLearning(OfflineFirst):
    """Settings of a run, beside those of :class:`OfflineFirst`.

    Attributes:
        expectile: tau, 0.5 for the mean of the tried actions, near 1 for the best of them.
        beta: how sharply the actor prefers actions by their advantage; near 0 it is behavioural cloning.
        weight_limit: what no weight exceeds.
    """

    name: ClassVar[str] = "iql"

    expectile: float = 0.7
    beta: float = 3.0
    weight_limit: float = 100.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_share(self, "expectile", below_one=True)
        require_positive(self, "expectile", "beta", "weight_limit")

    def learn(self, run: OnlineRun) -> ChunkPolicy:
        agent = ImplicitAgent(self, run.build_actor(SquashedGaussian), run.sizes)
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


class ImplicitAgent(Agent):
    """Actor, a state-value critic, and two action-value critics with slowly following target networks.

    Args:
        settings: of the algorithm. actor: the policy's network. sizes: elements of an observation and of an action.
    """

    def __init__(self, settings: ImplicitQLearning, actor: SquashedGaussian, sizes: tuple[int, int]) -> None:
        self.settings, self.actor = settings, actor
        critics = settings.build_critics(sizes[0] + 1 + sizes[1])
        value = settings.build_critics(sizes[0] + 1, 1)
        self._actor_state = TrainState(actor, adam(actor, settings.lr))
        self._critics = TrainState(critics, adam(critics, settings.lr))
        self._value = TrainState(value, adam(value, settings.lr))
        self._targets = Target(critics)
        super().__init__(
            {"actor": self._actor_state, "critics": self._critics, "value": self._value}, {"targets": self._targets}
        )

    def explore(self, obs: np.ndarray) -> np.ndarray:
        """Sample actions (n, Da) for encoded observations (n, Do)."""
        return sampled(self.actor, obs)

    def update(self, batch: Batch) -> dict[str, float]:
        """Take one step of both kinds of critic and of the targets and, where it is due, of the actor."""
        with torch.no_grad():
            worth = self._targets.network(batch.obs, batch.actions).min(0).values
        advantages = worth - self.values(batch.obs)
        value_loss = expectile_loss(advantages, self.settings.expectile)
        critic_loss, metrics = self.critic_loss(batch)
        self.updates += 1
        if self.updates % self.settings.actor_every == 0:
            actor_loss, found = self.actor_loss(batch, advantages.detach())
            smooth = self.settings.smoothness.loss(self.actor, batch.obs[:, :-1], batch.next_obs[:, :-1])
            self._actor_state.descend(actor_loss + smooth)
            metrics |= found
        self._value.descend(value_loss)
        self._critics.descend(critic_loss)
        self._targets.follow(self.settings.tau)
        return {"value/loss": value_loss.item(), **metrics}

    def critic_loss(self, batch: Batch) -> tuple[Tensor, dict[str, float]]:
        """Return the squared distance of both critics from ``r + gamma * V(s')``."""
        with torch.no_grad():
            targets = batch.rewards + self.settings.gamma * batch.continues * self.values(batch.next_obs)
        values = self._critics.network(batch.obs, batch.actions)
        loss = ((values - targets) ** 2).mean(1).sum()
        return loss, {"critic/loss": loss.item(), "critic/value": values.mean().item()}

    def actor_loss(self, batch: Batch, advantages: Tensor) -> tuple[Tensor, dict[str, float]]:
        """Return ``-w log pi(a | s)`` without the absorbing state, where none is chosen."""
        alive = 1.0 - batch.obs[:, -1]
        share = alive / alive.sum().clamp(min=1.0)
        weights = (self.settings.beta * advantages).exp().clamp(max=self.settings.weight_limit)
        log_prob, _ = self.actor.judge(batch.obs[:, None, :-1], unsquashed(batch.actions))
        loss = -(share * weights * log_prob).sum()
        found = {"actor/advantage": (share * advantages).sum().item(), "actor/weight": (share * weights).sum().item()}
        return loss, {"actor/loss": loss.item(), **found}

    def values(self, obs: Tensor) -> Tensor:
        """Return ``V(s)`` (B,) for observations (B, Do + 1)."""
        return self._value.network(obs, obs[:, :0])[0]


def expectile_loss(errors: Tensor, expectile: float) -> Tensor:
    """Return ``mean |tau - 1(u < 0)| u^2`` of errors u (B,), least at the expectile tau of what they are errors of."""
    return ((expectile - (errors < 0).float()).abs() * errors**2).mean()
