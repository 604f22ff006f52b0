"""REINFORCE with a baseline: the return that follows an action makes it more likely, or less likely.

Each turn collects ``rollout`` steps or a few more, cutting episodes that are in progress, and takes one step up

    ``E[(G_t - V(s_t)) grad log pi(a_t | s_t)]``,    G_t = sum over k of gamma^k r_{t+k} to the episode's end,

where the baseline V, learned after the step, adds no bias and reduces the variance. Where an episode was only cut, by
its time limit or by the rollout's end, G_t bootstraps from the baseline there; what the rollout's end cut goes on in
the next turn.

Observations are standardised by their running moments, rewards divided by the running standard deviation of returns,
and advantages standardised over the rollout.

Metrics: ``actor/loss``, ``actor/entropy``, ``critic/loss``, ``critic/value``; ``episode/return``, ``episode/length``,
``episode/success`` of the exploring policy; ``evaluate/<name>``; ``elapsed_s``.

Source: R. Williams, "Simple Statistical Gradient-Following Algorithms for Connectionist Reinforcement Learning", 1992;
R. Sutton, A. Barto, "Reinforcement Learning: An Introduction", 2018, section 13.4.
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
from aerial_il.algorithms.rl.on_policy import OnPolicy, Rollout, collect_rollout, require_compared
from aerial_il.algorithms.rl.reinforcement import Reinforcement
from aerial_il.algorithms.rl.returns import RewardNorm
from aerial_il.algorithms.run.checks import require_positive
from aerial_il.algorithms.run.state import Snapshot, joined, separate
from aerial_il.algorithms.run.train_state import TrainState, adam
from aerial_il.core.tensors import tensor
from aerial_il.policies.categorical import Categorical
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import PolicySettings, StochasticNetwork
from aerial_il.policies.squashed_gaussian import SquashedGaussian


@dataclass(frozen=True, kw_only=True)
class REINFORCE(Reinforcement, OnPolicy):
    """Settings of a run, beside those of :class:`Reinforcement` and :class:`OnPolicy`.

    Attributes:
        epochs: the baseline's passes over a rollout. batch_size: transitions in its minibatches.
    """

    name: ClassVar[str] = "reinforce"
    trains: ClassVar[tuple[type[PolicySettings], ...]] = (SquashedGaussian, Categorical)

    lr: float = 3e-3
    gae_lambda: float = 1.0  # Monte Carlo returns, and the baseline where an episode was cut
    epochs: int = 5
    batch_size: int = 64

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "epochs")
        require_compared(self, "batch_size")

    def learn(self, run: OnlineRun) -> ChunkPolicy:
        agent = ReinforceAgent(self, run.build_actor(StochasticNetwork), run.sizes[0])
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


class ReinforceAgent:
    """An actor, and its baseline.

    Args:
        settings: of the algorithm.
        actor: the policy's network.
        obs_size: Do.
    """

    def __init__(self, settings: REINFORCE, actor: StochasticNetwork, obs_size: int) -> None:
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
        self._actor.set_lr(settings.lr * left)
        found = self._baseline.advantages(rollout, rewards, gamma=settings.gamma, gae_lambda=settings.gae_lambda)
        brought = (found.advantages - found.advantages.mean()) / (found.advantages.std() + 1e-8)
        raw, after = (tensor(np.asarray(rollout.flat(name), np.float32)) for name in ("raw", "next_obs"))
        log_prob, entropy = self.actor.judge(found.obs[:, None], raw)
        loss = -(brought * log_prob).mean() + settings.smoothness.loss(self.actor, found.obs, after)
        self._actor.descend(loss)
        critic_loss = self._baseline.fit(found, epochs=settings.epochs, batch_size=settings.batch_size)
        actor = {"actor/loss": loss.item(), "actor/entropy": entropy.mean().item()}
        return {**actor, "critic/loss": critic_loss, "critic/value": found.value}

    def snapshot(self) -> Snapshot:
        return Snapshot(joined({"actor": self._actor, "critic": self._baseline}).arrays)

    def restore(self, saved: Snapshot) -> None:
        separate(saved, {"actor": self._actor, "critic": self._baseline})
