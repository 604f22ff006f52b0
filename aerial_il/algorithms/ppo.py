"""Proximal policy optimisation: reinforcement learning from the environment's own reward, one rollout at a time.

Each turn collects ``rollout.steps`` steps, estimates generalised advantages A, and updates actor and critic on them in
several epochs, the actor kept near the policy that acted: it maximises

    ``min(rho A, clip(rho, 1 - clip, 1 + clip) A)``,    rho = pi(a | s) / pi_old(a | s).

Observations are standardised by their running moments, rewards divided by the running standard deviation of returns;
where an episode was only cut by its time limit, its return bootstraps from the critic.

Metrics: ``actor/loss``, ``actor/approx_kl`` (Kullback-Leibler divergence), ``actor/clip_fraction``, ``critic/loss``,
``critic/value``; ``episode/return``, ``episode/length``, ``episode/success`` of the exploring policy;
``evaluate/<name>``; ``elapsed_s``.

Source: J. Schulman et al., "Proximal Policy Optimization Algorithms", 2017, equation 7;
defaults are those of its table 3.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from aerial_il.algorithms.on_policy.actor_critic import ActorCritic, minibatches
from aerial_il.algorithms.on_policy.advantages import Advantages, Judged
from aerial_il.algorithms.on_policy.loop import check_rollout, learn_step_by_step
from aerial_il.algorithms.on_policy.settings import Rollout
from aerial_il.algorithms.online.algorithm import Algorithm
from aerial_il.algorithms.online.problem import Given, Problem, Source, from_reward
from aerial_il.algorithms.online.replay_buffer import ReplayBuffer, bc_pretrain
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.online.smoothness import NO_SMOOTHNESS, Smoothness
from aerial_il.algorithms.run.cadence import Cadence
from aerial_il.algorithms.run.train_state import TrainState, adam
from aerial_il.policies.categorical import Categorical
from aerial_il.policies.parts.network import PolicySettings, StochasticNetwork
from aerial_il.policies.squashed_gaussian import SquashedGaussian


@dataclass(frozen=True, kw_only=True)
class PPO(Algorithm):
    """Proximal policy optimisation (Schulman et al. 2017, table 3).

    Attributes:
        lr: learning rate at the start; it falls linearly to zero.
        entropy: weight of the entropy.
    """

    name: ClassVar[str] = "ppo"
    trains: ClassVar[tuple[type[PolicySettings], ...]] = (SquashedGaussian, Categorical)

    steps: int = 300_000
    gamma: float = 0.99
    gae_lambda: float = 0.95
    lr: float = 3e-4
    clip: float = 0.2
    entropy: float = 0.0
    clip_norm: float = 0.5
    target_kl: float = 0.0
    critic_hidden: tuple[int, ...] = (64, 64)
    rollout: Rollout = Rollout(steps=2048, epochs=10, batch_size=64)
    reward: Source = "environment"
    reward_patience: int = 200_000
    smoothness: Smoothness = Smoothness(temporal=0.0, spatial=0.0, radius=0.05, rate_penalty=0.0, jerk_penalty=0.0)
    cadence: Cadence = Cadence(log_every=5_000, evaluate_every=0, checkpoint_every=50_000, keep_checkpoints=2)
    threads: int = 1

    def problem(self, given: Given) -> Problem:
        check_rollout(self, given.env)
        return from_reward(self, given)

    def learn(self, run: OnlineRun) -> None:
        learn_step_by_step(run, self, ProximalActorCritic)


class ProximalActorCritic[Actor: StochasticNetwork](ActorCritic[Actor]):
    """Actor and critic, updated in several passes over a rollout."""

    changing = ("_actor", "_critic")

    def __init__(self, settings: Algorithm, actor: Actor, obs_size: int) -> None:
        super().__init__(settings, actor, obs_size)
        self._actor = TrainState(actor, adam(actor, settings.lr))
        self._smoothness: Smoothness = getattr(settings, "smoothness", NO_SMOOTHNESS)

    def bc_pretrain(self, demos: ReplayBuffer, steps: int) -> None:
        """Move the actor's mean action towards demonstrated ones in ``steps`` minibatches."""
        size = self.settings.rollout.batch_size or len(demos)
        bc_pretrain(self._actor, self.actor, demos, steps=steps, batch_size=size)

    def learn(self, judged: Judged, *, left: float, improve: bool = True) -> dict[str, float]:
        """Learn from one rollout; the learning rate follows the share of the training that is ``left``."""
        for part in (self._actor, self._critic):
            part.set_lr(self.settings.lr * left)
        return self._passes(judged.data, improve=improve)

    def _passes(self, data: Advantages, *, improve: bool) -> dict[str, float]:
        """Go over a rollout several times; a pass that exceeds the KL limit, ``1.5 target_kl``, is the actor's last."""
        settings, passes = self.settings, list[np.ndarray]()
        with torch.no_grad():
            old_log_prob, _ = self.actor.judge(data.obs[:, None], data.raw)
        for _ in range(settings.rollout.epochs):
            rows = []
            for i in minibatches(len(data.obs), settings.rollout.batch_size):
                part = data.rows(i)
                critic_loss = self._critic.loss(part)
                self._critic.descend(critic_loss, clip_norm=settings.clip_norm)
                actor_loss, approx_kl, clipped = self.actor_loss(part, old_log_prob[i])
                if improve:
                    self._actor.descend(actor_loss, clip_norm=settings.clip_norm)
                rows.append((actor_loss.item(), critic_loss.item(), approx_kl, clipped))
            passes.append(np.mean(rows, axis=0))
            improve = improve and not (settings.target_kl and passes[-1][2] > 1.5 * settings.target_kl)
        names = ("actor/loss", "critic/loss", "actor/approx_kl", "actor/clip_fraction")
        return dict(zip(names, map(float, np.mean(passes, axis=0)), strict=True))

    def actor_loss(self, part: Advantages, old_log_prob: Tensor) -> tuple[Tensor, float, float]:
        """Return the clipped objective's loss, the KL divergence from the acting policy, and the share clipped."""
        clip = self.settings.clip
        log_prob, entropy = self.actor.judge(part.obs[:, None], part.raw)
        log_ratio = log_prob - old_log_prob
        ratio, gain = log_ratio.exp(), part.standardised
        kept = torch.minimum(ratio * gain, ratio.clamp(1 - clip, 1 + clip) * gain)
        loss = -kept.mean() - self.settings.entropy * entropy.mean()
        loss = loss + self._smoothness.loss(self.actor, part.obs, part.next_obs, execute=self.actor.execute)
        with torch.no_grad():
            approx_kl = (ratio - 1 - log_ratio).mean().item()
            clipped = ((ratio - 1).abs() > clip).float().mean().item()
        return loss, approx_kl, clipped
