"""Proximal policy optimisation: reinforcement learning from the environment's own reward, one rollout at a time.

Each turn collects ``rollout`` steps, estimates generalised advantages A, and updates actor and critic on them in
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

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
import torch
from torch import Tensor

from aerial_il.algorithms.online.cloning import bc_pretrain
from aerial_il.algorithms.online.interface import standardised
from aerial_il.algorithms.online.moments import RunningMoments
from aerial_il.algorithms.online.replay_buffer import ReplayBuffer
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.online.smoothness import NO_SMOOTHNESS, Smoothness
from aerial_il.algorithms.rl.baseline import Critic, minibatches
from aerial_il.algorithms.rl.on_policy import ProximalOnPolicy, Rollout, collect_rollout
from aerial_il.algorithms.rl.reinforcement import Reinforcement
from aerial_il.algorithms.rl.returns import RewardNorm, gae
from aerial_il.algorithms.run.state import Snapshot, joined, separate
from aerial_il.algorithms.run.train_state import TrainState, adam
from aerial_il.core.tensors import tensor
from aerial_il.policies.categorical import Categorical
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import PolicySettings, StochasticNetwork
from aerial_il.policies.squashed_gaussian import SquashedGaussian


@dataclass(frozen=True, kw_only=True)
class PPO(Reinforcement, ProximalOnPolicy):
    """Settings of a run; see :class:`Reinforcement` and :class:`ProximalOnPolicy`."""

    name: ClassVar[str] = "ppo"
    trains: ClassVar[tuple[type[PolicySettings], ...]] = (SquashedGaussian, Categorical)

    def learn(self, run: OnlineRun) -> ChunkPolicy:
        agent = ProximalActorCritic(self, run.build_actor(StochasticNetwork), run.sizes[0], smoothness=self.smoothness)
        obs_norm, reward_norm = RunningMoments(run.sizes[0]), RewardNorm(run.collector.n, self.gamma)
        run.begin(agent.actor, {"agent": agent, "obs_norm": obs_norm, "reward_norm": reward_norm})
        run.interface = standardised(run.interface, obs_norm)

        while run.goes_on():
            rollout = collect_rollout(run.collector, run.interface, agent, self.rollout)
            rewards = reward_norm.scale(rollout.rewards, rollout.ended)
            run.log(agent.update(rollout, rewards, left=run.left))
            obs_norm.add(run.interface.layout.relate(rollout.flat("frames")))
            run.interface = standardised(run.interface, obs_norm)
            run.end_turn()

        return run.finish()


class Advantages(NamedTuple):
    """T * n steps: obs, next_obs (·, Do), raw (·, R), advantages (·,) and the critic's targets (·,)."""

    obs: Tensor
    next_obs: Tensor
    raw: Tensor
    advantages: Tensor
    targets: Tensor


class ProximalActorCritic[Actor: StochasticNetwork]:
    """Actor and critic, updated in several passes over a rollout.

    Args:
        settings: of the algorithm.
        actor: the policy's network.
        obs_size: Do.
        smoothness: how the actor is held back from rough actions; None for not at all.
    """

    def __init__(
        self, settings: ProximalOnPolicy, actor: Actor, obs_size: int, *, smoothness: Smoothness | None = None
    ) -> None:
        self.settings, self.actor, critic = settings, actor, Critic(obs_size, settings.critic_hidden)
        self._smoothness = smoothness or NO_SMOOTHNESS
        self._actor, self._critic = (
            TrainState(actor, adam(actor, settings.lr)),
            TrainState(critic, adam(critic, settings.lr)),
        )

    @torch.no_grad()
    def explore(self, obs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Sample actions (n, Da), ``raw`` samples (n, R) and log densities (n,) for observations (n, Do)."""
        drawn = self.actor.sample(tensor(obs)[:, None])
        return drawn[0].numpy(), drawn[1].numpy(), drawn[2].numpy()

    @torch.no_grad()
    def values(self, obs: np.ndarray) -> np.ndarray:
        """Return the critic's values (...) of encoded observations (..., Do)."""
        return self._critic.network(tensor(obs)).numpy()

    def bc_pretrain(self, demos: ReplayBuffer, steps: int) -> None:
        """Move the actor's mean action towards demonstrated ones in ``steps`` minibatches."""
        bc_pretrain(self._actor, self.actor, demos, steps=steps, batch_size=self.settings.batch_size)

    def update(
        self,
        rollout: Rollout,
        rewards: np.ndarray,
        *,
        left: float,
        end_values: np.ndarray | float = 0.0,
        improve: bool = True,
    ) -> dict[str, float]:
        """Learn from one rollout.

        Args:
            rewards: (T, n) of each step, normalised.
            left: share of the training that is left; the learning rate follows it.
            end_values: (T, n) the value after each terminal step; elsewhere of no effect.
            improve: whether the actor is updated; otherwise the critic alone learns its value.
        """
        values, next_values = self.values(rollout.obs), self.values(rollout.next_obs)
        next_values = np.where(rollout.terminal, end_values, next_values)
        factors = {"gamma": self.settings.gamma, "gae_lambda": self.settings.gae_lambda}
        advantages = gae(rewards, values, next_values, rollout.ended, **factors)
        targets = (advantages + values).ravel()
        for part in (self._actor, self._critic):
            part.set_lr(self.settings.lr * left)
        seen = (rollout.flat(name) for name in ("obs", "next_obs", "raw"))
        data = Advantages(*(tensor(np.asarray(a, np.float32)) for a in (*seen, advantages.ravel(), targets)))
        return {**self._passes(data, improve=improve), "critic/value": float(values.mean())}

    def _passes(self, data: Advantages, *, improve: bool) -> dict[str, float]:
        """Go over a rollout several times; a pass that exceeds the KL limit, ``1.5 target_kl``, is the actor's last."""
        with torch.no_grad():
            old_log_prob, _ = self.actor.judge(data.obs[:, None], data.raw)
        passes: list[np.ndarray] = []
        for _ in range(self.settings.epochs):
            rows = []
            for i in minibatches(len(data.obs), self.settings.batch_size):
                part = Advantages(*(column[i] for column in data))
                critic_loss = self.critic_loss(part.obs, part.targets)
                self._critic.descend(critic_loss, clip_norm=self.settings.clip_norm)
                actor_loss, approx_kl, clipped = self.actor_loss(part, old_log_prob[i])
                if improve:
                    self._actor.descend(actor_loss, clip_norm=self.settings.clip_norm)
                rows.append((actor_loss.item(), critic_loss.item(), approx_kl, clipped))
            passes.append(np.mean(rows, axis=0))
            improve = improve and not (self.settings.target_kl and passes[-1][2] > 1.5 * self.settings.target_kl)
        names = ("actor/loss", "critic/loss", "actor/approx_kl", "actor/clip_fraction")
        return dict(zip(names, map(float, np.mean(passes, axis=0)), strict=True))

    def critic_loss(self, obs: Tensor, targets: Tensor) -> Tensor:
        """Return the critic's mean squared error."""
        return ((self._critic.network(obs) - targets) ** 2).mean()

    def actor_loss(self, part: Advantages, old_log_prob: Tensor) -> tuple[Tensor, float, float]:
        """Return the clipped objective's loss, the KL divergence from the acting policy, and the share clipped."""
        clip = self.settings.clip
        log_prob, entropy = self.actor.judge(part.obs[:, None], part.raw)
        log_ratio = log_prob - old_log_prob
        ratio = log_ratio.exp()
        gain = (part.advantages - part.advantages.mean()) / (part.advantages.std() + 1e-8)
        kept = torch.minimum(ratio * gain, ratio.clamp(1 - clip, 1 + clip) * gain)
        loss = -kept.mean() - self.settings.entropy * entropy.mean()
        loss = loss + self._smoothness.loss(self.actor, part.obs, part.next_obs, execute=self.actor.execute)
        with torch.no_grad():
            approx_kl = (ratio - 1 - log_ratio).mean().item()
            clipped = ((ratio - 1).abs() > clip).float().mean().item()
        return loss, approx_kl, clipped

    def snapshot(self) -> Snapshot:
        return Snapshot(joined({"actor": self._actor, "critic": self._critic}).arrays)

    def restore(self, saved: Snapshot) -> None:
        separate(saved, {"actor": self._actor, "critic": self._critic})
