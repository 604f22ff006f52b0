"""Proximal policy optimisation initialised from a clone (BC-PPO), chunk by chunk, and kept from falling below it.

The clone's own network goes on learning, whatever its class, as the mean of the sampled chunks; a chunk is one action
for PPO, credited with all rewards until the next. Five things keep what the clone could do:

- up to ``warmup`` it flies alone, and a new critic learns its value;
- the loss is raised by ``kl`` times the KL divergence from the clone, less and less over the training;
- a rollout's updates of the actor stop where they exceed the KL limit, ``target_kl``;
- where the episodes of a rollout return less than the clone's, by more than ``gate`` standard errors, the actor goes
  back to the last weights that were not worse;
- what is evaluated and saved is the clone, until what was learned flies as well without noise (``trial``).

Metrics: ``actor/loss``, ``actor/approx_kl``, ``actor/clip_fraction``, ``actor/divergence`` (from the clone),
``actor/fallbacks`` (share of rollouts that were given up), ``critic/loss``, ``critic/value``; ``trial/return`` and
``trial/prior`` (mean returns of what was learned and of the clone in a trial); ``episode/return``, ``episode/length``,
``episode/success`` of the exploring policy; ``evaluate/<name>`` of what would be handed over, at step 0 the clone;
``elapsed_s``.

Source: J. Schulman et al., "Proximal Policy Optimization Algorithms", 2017, equation 7. Chunks as actions are those of
A. Ren et al., "Diffusion Policy Policy Optimization", 2024, section 4; the divergence from the clone is that of
B. Baker et al., "Video PreTraining (VPT)", 2022, section 4.4; warm-up, gate and trials are ours.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from aerial_il.algorithms.decisions.chunk_actor import ChunkPilot
from aerial_il.algorithms.decisions.gate import ReturnGate
from aerial_il.algorithms.decisions.practice import AnchoredOnPolicy, GatedOnPolicy, Practice, PractisedChunks
from aerial_il.algorithms.decisions.rollout import collect_decisions, judged
from aerial_il.algorithms.online.smoothness import Smoothness
from aerial_il.algorithms.ppo import Advantages, ProximalActorCritic
from aerial_il.algorithms.rl.returns import RewardNorm
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import StochasticNetwork


@dataclass(frozen=True, kw_only=True)
class BCPPO(PractisedChunks, GatedOnPolicy):
    """Settings of a run; see :class:`PractisedChunks` and :class:`GatedOnPolicy`."""

    name: ClassVar[str] = "bc_ppo"

    steps: int = 16_000_000
    gamma: float = 0.995

    def practise(self, practice: Practice) -> ChunkPolicy:
        run, prior = practice.run, practice.prior
        actor = self.actor(practice)
        size = prior.config.history * run.sizes[0]
        agent = AnchoredActorCritic(self, actor, size, smoothness=self.smoothness)
        pilot = ChunkPilot(actor, prior, run.collector)
        gate, reward_norm = ReturnGate(actor, run.collector.n, self.gate), RewardNorm(run.collector.n, self.gamma)
        hand_over = self.hand_over(practice, actor)
        parts = {"agent": agent, "pilot": pilot, "gate": gate, "reward_norm": reward_norm, "hand_over": hand_over}
        run.begin(actor.network, parts)

        while run.goes_on():
            warming_up = run.collector.steps < self.warmup
            decisions = collect_decisions(run.collector, pilot, self.rollout)
            improve = gate.passes(decisions, warming_up=warming_up)
            rewards = reward_norm.scale(decisions.rewards, decisions.ended)
            found = judged(decisions, agent.values, rewards, gamma=self.gamma, gae_lambda=self.gae_lambda)
            run.log(agent.learn(found.data, left=run.left, improve=improve))
            run.log({"critic/value": found.value, "actor/fallbacks": float(not (improve or warming_up))})
            run.log(hand_over.after_learning() if improve else {})
            run.end_turn()

        return hand_over.finish()


class AnchoredActorCritic(ProximalActorCritic[StochasticNetwork]):
    """Actor and critic, the actor held near the policy that it starts from.

    Args:
        settings: of the algorithm. actor: what explores, as it starts. obs_size: elements that a decision sees.
        smoothness: how the actor is held back from rough actions.
    """

    def __init__(
        self, settings: AnchoredOnPolicy, actor: StochasticNetwork, obs_size: int, *, smoothness: Smoothness
    ) -> None:
        super().__init__(settings, actor, obs_size, smoothness=smoothness)
        self._begun, self._anchored, self._pull = copy.deepcopy(actor).requires_grad_(False), settings, settings.kl

    def learn(self, data: Advantages, *, left: float, improve: bool) -> dict[str, float]:
        """Learn from one rollout's decisions.

        Args:
            left: share of the training that is left; the actor's learning rate and the pull back follow it.
            improve: whether the actor is updated.
        """
        self._pull = self._anchored.kl * left
        self._actor.set_lr(self._anchored.lr * left)
        self._critic.set_lr(self._anchored.critic_lr)
        metrics = self._passes(data, improve=improve)
        with torch.no_grad():
            return {**metrics, "actor/divergence": self._away(data.obs).mean().item()}

    def actor_loss(self, part: Advantages, old_log_prob: Tensor) -> tuple[Tensor, float, float]:
        """Return PPO's loss and the pull to the clone, the divergence from the acting policy, and the share clipped."""
        loss, approx_kl, clipped = super().actor_loss(part, old_log_prob)
        return loss + self._pull * self._away(part.obs).mean(), approx_kl, clipped

    def _away(self, obs: Tensor) -> Tensor:
        """Return the KL divergence (B,) from the initial policy for what decisions saw (B, Do)."""
        seen = obs[:, None]
        return self.actor.divergence(self.actor.distribution(seen), self._begun.distribution(seen))
