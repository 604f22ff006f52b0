"""Advantage actor-critic (A2C): a few steps of every world, one step of actor and critic, and on.

Each turn collects ``rollout`` steps, estimates generalised advantages A (with ``gae_lambda`` 1 the discounted rewards
to the rollout's end and the critic's estimate there, less the estimate at the step), and takes one step to minimise

    ``-E[A log pi(a | s)] - entropy * H(pi)``    and    ``E[(V(s) - R)^2]``.

Observations are standardised by their running moments, rewards divided by the running standard deviation of returns;
where an episode was only cut by its time limit, its return bootstraps from the critic.

Metrics: ``actor/loss``, ``actor/entropy``, ``critic/loss``, ``critic/value``; ``episode/return``, ``episode/length``,
``episode/success`` of the exploring policy; ``evaluate/<name>``; ``elapsed_s``.

Source: V. Mnih et al., "Asynchronous Methods for Deep Reinforcement Learning", 2016, algorithm S3, its workers
synchronous and its optimiser Adam.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch

from aerial_il.algorithms.online.interface import standardised
from aerial_il.algorithms.online.moments import RunningMoments
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.rl.baseline import Baseline
from aerial_il.algorithms.rl.on_policy import OnPolicy, Rollout, collect_rollout
from aerial_il.algorithms.rl.reinforcement import Reinforcement
from aerial_il.algorithms.rl.returns import RewardNorm
from aerial_il.algorithms.run.checks import require_not_negative, require_positive
from aerial_il.algorithms.run.state import Snapshot, joined, separate
from aerial_il.algorithms.run.train_state import TrainState, adam
from aerial_il.core.tensors import tensor
from aerial_il.policies.categorical import Categorical
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import PolicySettings, StochasticNetwork
from aerial_il.policies.squashed_gaussian import SquashedGaussian


@dataclass(frozen=True, kw_only=True)
class A2C(Reinforcement, OnPolicy):
    """Settings of a run, beside those of :class:`Reinforcement` and :class:`OnPolicy`.

    Attributes:
        entropy: weight of the entropy. clip_norm: largest gradient norm of the actor.
    """

    name: ClassVar[str] = "a2c"
    trains: ClassVar[tuple[type[PolicySettings], ...]] = (SquashedGaussian, Categorical)

    rollout: int = 64
    lr: float = 7e-4
    gae_lambda: float = 1.0
    entropy: float = 0.0
    clip_norm: float = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "clip_norm")
        require_not_negative(self, "entropy")

    def learn(self, run: OnlineRun) -> ChunkPolicy:
        agent = AdvantageAgent(self, run.build_actor(StochasticNetwork), run.sizes[0])
        obs_norm, reward_norm = RunningMoments(run.sizes[0]), RewardNorm(run.collector.n, self.gamma)
        run.begin(agent.actor, {"agent": agent, "obs_norm": obs_norm, "reward_norm": reward_norm})
        run.interface = standardised(run.interface, obs_norm)

        while run.goes_on():
            rollout = collect_rollout(run.collector, run.interface, agent, self.rollout)
            run.log(agent.update(rollout, reward_norm.scale(rollout.rewards, rollout.ended), left=run.left))
            obs_norm.add(run.interface.layout.relate(rollout.flat("frames")))
            run.interface = standardised(run.interface, obs_norm)
            run.end_turn()

        return run.finish()


class AdvantageAgent:
    """An actor, and the critic that estimates advantages; both take one step for each rollout.

    Args:
        settings: of the algorithm.
        actor: the policy's network.
        obs_size: Do.
    """

    def __init__(self, settings: A2C, actor: StochasticNetwork, obs_size: int) -> None:
        self.settings, self.actor = settings, actor
        self._actor = TrainState(actor, adam(actor, settings.lr))
        self._baseline = Baseline(obs_size, settings.critic_hidden, lr=settings.lr)

    @torch.no_grad()
    def explore(self, obs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Sample actions (n, Da), ``raw`` samples (n, R) and log densities (n,) for observations (n, Do)."""
        drawn = self.actor.sample(tensor(obs)[:, None])
        return drawn[0].numpy(), drawn[1].numpy(), drawn[2].numpy()

    def update(self, rollout: Rollout, rewards: np.ndarray, *, left: float) -> dict[str, float]:
        """Take one step by a rollout and its scaled rewards (T, n), when the share ``left`` of the training is left."""
        settings = self.settings
        for part in (self._actor, self._baseline):
            part.set_lr(settings.lr * left)
        found = self._baseline.advantages(rollout, rewards, gamma=settings.gamma, gae_lambda=settings.gae_lambda)
        raw, after = (tensor(np.asarray(rollout.flat(name), np.float32)) for name in ("raw", "next_obs"))
        log_prob, entropy = self.actor.judge(found.obs[:, None], raw)
        loss = -(found.advantages * log_prob).mean() - settings.entropy * entropy.mean()
        loss = loss + settings.smoothness.loss(self.actor, found.obs, after)
        self._actor.descend(loss, clip_norm=settings.clip_norm)
        critic_loss = self._baseline.fit(found, epochs=1, batch_size=len(found.obs))
        actor = {"actor/loss": loss.item(), "actor/entropy": entropy.mean().item()}
        return {**actor, "critic/loss": critic_loss, "critic/value": found.value}

    def snapshot(self) -> Snapshot:
        return Snapshot(joined({"actor": self._actor, "critic": self._baseline}).arrays)

    def restore(self, saved: Snapshot) -> None:
        separate(saved, {"actor": self._actor, "critic": self._baseline})
