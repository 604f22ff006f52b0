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

import copy
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.on_policy.advantages import Advantages, Judged
from aerial_il.algorithms.on_policy.chunk_actor import ChunkPilot
from aerial_il.algorithms.on_policy.from_clone import FromClone, Start
from aerial_il.algorithms.on_policy.gate import ReturnGate
from aerial_il.algorithms.on_policy.hand_over import HandOver
from aerial_il.algorithms.on_policy.loop import learn_on_policy
from aerial_il.algorithms.on_policy.settings import Exploration, Rollout, Trial
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.problem import Source
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.online.smoothness import Smoothness
from aerial_il.algorithms.ppo import ProximalActorCritic
from aerial_il.algorithms.run.cadence import Cadence
from aerial_il.policies.parts.network import StochasticNetwork


@dataclass(frozen=True, kw_only=True)
class BCPPO(FromClone):
    """Proximal policy optimisation from a clone.

    The divergences of all numbers of a chunk add up, and there are tens: ``clip`` and ``target_kl`` are wide.

    Attributes:
        lr: the actor's learning rate at the start; it falls linearly to zero.
        entropy: weight of the entropy.
    """

    name: ClassVar[str] = "bc_ppo"

    steps: int = 4_000_000
    warmup: int = 50_000
    gamma: float = 0.995
    gae_lambda: float = 0.95
    lr: float = 1e-4
    critic_lr: float = 1e-3
    critic_hidden: tuple[int, ...] = (128, 128)
    clip: float = 0.9
    entropy: float = 0.0
    clip_norm: float = 0.5
    target_kl: float = 1.0
    kl: float = 0.001
    gate: float = 2.0
    rollout: Rollout = Rollout(steps=65_536, epochs=5, batch_size=1024)
    exploration: Exploration = Exploration(execute=10, noise=0.15, correlation=0.9)
    trial: Trial = Trial(flights=128, every=400_000)
    prior: str | None = None
    cloning: BC = BC(steps=6_000, validation=0.0, field_dropout=0.6)
    patience: float = 2.0
    reward: Source = "sparse"
    reward_patience: int = 200_000
    smoothness: Smoothness = Smoothness(temporal=0.0, spatial=0.0, radius=0.05, rate_penalty=0.0, jerk_penalty=0.0)
    cadence: Cadence = Cadence(log_every=50_000, evaluate_every=0, checkpoint_every=50_000, keep_checkpoints=2)
    threads: int = 1

    def learn(self, run: OnlineRun) -> None:
        start: Start = run.problem.start
        actor = start.chunk_actor(run, self.exploration)
        agent = AnchoredActorCritic(self, actor, start.prior.config.history * run.sizes[0])
        pilot = ChunkPilot(actor, start.prior, run.collector)
        gate = ReturnGate(actor, run.collector.n, self.gate)
        hand_over = HandOver(run, start.alone, actor.network, self.trial)
        learn_on_policy(run, self, pilot, agent, actor.network, warmup=self.warmup, gate=gate, hand_over=hand_over)


class AnchoredActorCritic(ProximalActorCritic[StochasticNetwork]):
    """Actor and critic, the actor held near the policy that it starts from.

    Args:
        settings: of the algorithm. actor: what explores, as it starts. obs_size: elements that a decision sees.
    """

    def __init__(self, settings: Algorithm, actor: StochasticNetwork, obs_size: int) -> None:
        super().__init__(settings, actor, obs_size)
        self._first, self._pull = copy.deepcopy(actor).requires_grad_(False), settings.kl

    def learn(self, judged: Judged, *, left: float, improve: bool = True) -> dict[str, float]:
        """Learn from one rollout; the actor's learning rate and the pull back follow the share that is ``left``."""
        self._pull = self.settings.kl * left
        self._actor.set_lr(self.settings.lr * left)
        self._critic.set_lr(self.settings.critic_lr)
        metrics = self._passes(judged.data, improve=improve)
        with torch.no_grad():
            return {**metrics, "actor/divergence": self._away(judged.data.obs).mean().item()}

    def actor_loss(self, part: Advantages, old_log_prob: Tensor) -> tuple[Tensor, float, float]:
        """Return PPO's loss and the pull to the clone, the divergence from the acting policy, and the share clipped."""
        loss, approx_kl, clipped = super().actor_loss(part, old_log_prob)
        return loss + self._pull * self._away(part.obs).mean(), approx_kl, clipped

    def _away(self, obs: Tensor) -> Tensor:
        """Return the KL divergence (B,) from the initial policy for what decisions saw (B, Do)."""
        seen = obs[:, None]
        return self.actor.divergence(self.actor.distribution(seen), self._first.distribution(seen))
