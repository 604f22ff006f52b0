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

``control=random_actions`` puts as many transitions of random flights, with their rewards, in the demonstrations' place.

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

import numpy as np
import torch
from torch import Tensor, nn

from aerial_il.algorithms.rl.agent import Agent, sampled
from aerial_il.algorithms.rl.bc_pretraining import bc_loss
from aerial_il.algorithms.rl.critics import Target, check_ensemble
from aerial_il.algorithms.rl.demonstrated import RelabelledDemonstrated
from aerial_il.algorithms.rl.off_policy import RandomActions, SoftOffPolicy
from aerial_il.algorithms.rl.online_run import OnlineRun
from aerial_il.algorithms.rl.replay.experience_replay import ExperienceReplay
from aerial_il.algorithms.rl.replay.replay_buffer import Batch, concatenated
from aerial_il.algorithms.run.checks import require_not_negative
from aerial_il.algorithms.run.train_state import TrainState, adam
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.squashed_gaussian import SquashedGaussian


@dataclass(frozen=True, kw_only=True)
class PriorDataLearning(RelabelledDemonstrated, SoftOffPolicy):
    """Settings of a run; see :class:`RelabelledDemonstrated` and :class:`SoftOffPolicy`.

    Attributes:
        critics: ensemble size E. subset: how many of its targets Z the backup takes the minimum of.
        bc_weight: weight of the actor's squared distance from demonstrated actions beside the critics' values.
    """

    name: ClassVar[str] = "rlpd"

    utd_ratio: float = 4.0
    actor_every: int = 4
    entropy: float = -0.5
    critic_norm: bool = True
    critics: int = 10
    subset: int = 2
    bc_weight: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_ensemble(self)
        require_not_negative(self, "bc_weight")

    def learn(self, run: OnlineRun) -> ChunkPolicy:
        agent = EnsembleActorCritic(self, run.build_actor(SquashedGaussian), run.sizes)
        blind = RandomActions(run.sizes[1], run.rng("warm-up"))
        demos = run.demos.buffer(run.interface, run.rng("demonstrations"), absorbing=self.absorbing, reward=None)
        replay = ExperienceReplay(run, self.buffer_size, hindsight=self.hindsight, absorbing=self.absorbing)
        run.begin(agent.actor, {"agent": agent, "demonstrations": demos, **replay.parts, "random_actions": blind})

        while run.goes_on():
            warming_up = run.collector.steps < self.warmup
            replay.step(blind if warming_up else agent)

            agent.set_lr(self.lr_at(run.left))
            for _ in range(0 if warming_up else run.updates_due(self.utd_ratio)):
                half = self.batch_size // 2
                shown = demos.sample(half)
                run.log(agent.update(concatenated(shown, replay.sample(self.batch_size - half)), shown))
            run.end_turn()

        return run.finish()


class EnsembleActorCritic(Agent):
    """Actor, an ensemble of critics, slowly following target networks and the temperature alpha.

    Args:
        settings: of the algorithm. actor: the policy's network. sizes: elements of an observation and of an action.
    """

    def __init__(self, settings: PriorDataLearning, actor: SquashedGaussian, sizes: tuple[int, int]) -> None:
        self.settings, self.actor = settings, actor
        critics = settings.build_critics(sizes[0] + 1 + sizes[1], settings.critics)
        temperature = nn.ParameterList([nn.Parameter(torch.tensor(math.log(settings.alpha)))])
        self._log_alpha, self._target_entropy = temperature[0], settings.entropy * sizes[1]
        improved = nn.ModuleDict({"policy": actor, "temperature": temperature})
        self._actor_state = TrainState(improved, adam(improved, settings.lr))
        self._critics = TrainState(critics, adam(critics, settings.lr))
        self._targets = Target(critics)
        super().__init__({"actor": self._actor_state, "critics": self._critics}, {"targets": self._targets})

    def explore(self, obs: np.ndarray) -> np.ndarray:
        """Sample actions (n, Da) for encoded observations (n, Do)."""
        return sampled(self.actor, obs)

    def update(self, batch: Batch, demos: Batch) -> dict[str, float]:
        """Take one step of critics and targets and, where it is due, of actor and temperature.

        Args:
            batch: what they learn from. demos: the demonstrations in it.
        """
        loss, metrics = self.critic_loss(batch)
        self._critics.descend(loss)
        self._targets.follow(self.settings.tau)
        self.updates += 1
        if self.updates % self.settings.actor_every == 0:
            loss, found = self.actor_and_alpha_loss(batch)
            self._actor_state.descend(loss + self._pull(batch, demos))
            metrics |= found
        return metrics

    def critic_loss(self, batch: Batch) -> tuple[Tensor, dict[str, float]]:
        """Return the squared Bellman error, summed over the critics."""
        values = self._critics.network(batch.obs, batch.actions)
        loss = ((values - self.bellman_targets(batch)) ** 2).mean(1).sum()
        spread = values.detach().std(0, correction=0).mean().item()
        return loss, {"critic/loss": loss.item(), "critic/value": values.mean().item(), "critic/spread": spread}

    @torch.no_grad()
    def bellman_targets(self, batch: Batch) -> Tensor:
        """Return ``r + gamma * (min over Z of Q'(s', a') - alpha log pi(a' | s'))`` (B,)."""
        alive = 1.0 - batch.next_obs[:, -1]
        actions, _, log_prob = self.actor.sample(batch.next_obs[:, None, :-1])
        chosen = torch.randperm(self.settings.critics)[: self.settings.subset]
        worth = self._targets.network(batch.next_obs, alive[:, None] * actions, chosen).min(0).values
        soft_value = worth - self._log_alpha.exp() * alive * log_prob
        return batch.rewards + self.settings.gamma * batch.continues * soft_value

    def actor_and_alpha_loss(self, batch: Batch) -> tuple[Tensor, dict[str, float]]:
        """Return ``alpha log pi - mean Q`` plus alpha's own loss, without the absorbing state, where none is chosen.

        The first reaches the actor alone, the second alpha alone.
        """
        alive = 1.0 - batch.obs[:, -1]
        share, alpha = alive / alive.sum().clamp(min=1.0), self._log_alpha.detach().exp()
        actions, _, log_prob = self.actor.sample(batch.obs[:, None, :-1])
        worth = self._critics.network(batch.obs, actions).mean(0)
        actor_loss = (share * (alpha * log_prob - worth)).sum()
        entropy = -(share * log_prob.detach()).sum()
        alpha_loss = self._log_alpha * (entropy - self._target_entropy)
        found = {"actor/loss": actor_loss.item(), "actor/entropy": entropy.item(), "actor/alpha": alpha.item()}
        return actor_loss + alpha_loss, found

    def _pull(self, batch: Batch, demos: Batch) -> Tensor | float:
        """Return the loss that pulls the actor to demonstrated actions and holds it back from rough ones."""
        near = self.settings.bc_weight * bc_loss(self.actor, demos) if self.settings.bc_weight else 0.0
        return near + self.settings.smoothness.loss(self.actor, batch.obs[:, :-1], batch.next_obs[:, :-1])
