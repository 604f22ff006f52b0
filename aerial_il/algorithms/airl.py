"""Adversarial inverse reinforcement learning: imitation whose discriminator holds a reward that outlives the policy.

The loop and the loss, a cross-entropy, are those of :mod:`aerial_il.algorithms.gail`; the discriminator is another one,

    ``logit = f(s, a, s') - log pi(a | s)``,  ``f = g(s, a) + gamma * h(s') - h(s)``,

with the policy's own density pi in it. At the optimum f is the demonstrator's advantage and, where g sees states alone
(``reward_on: state``) and the dynamics allow it, g its reward up to a constant. The policy's reward is
g - log pi, the logit without the shaping by h, which changes no advantage; the density is an entropy bonus, and
``reward.form`` is that of g. What is kept with the run, and shown along an episode, is g.

It fails where demonstrations are few and the body has many joints (Ant, Walker2d for the peer), and where the density
of demonstrated actions at the edge of their bounds makes the logit arbitrary.

Source: J. Fu, K. Luo, S. Levine, "Learning Robust Rewards with Adversarial Inverse Reinforcement Learning", 2018,
equations 4 and 5.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal

import torch
from torch import Tensor, nn

from aerial_il.algorithms.adversarial.discriminator import Discriminator
from aerial_il.algorithms.adversarial.reward_net import LearnedReward, RewardNet, Shape
from aerial_il.algorithms.gail import GAIL
from aerial_il.algorithms.on_policy.settings import Rollout
from aerial_il.algorithms.online.demonstrations import Demonstrations
from aerial_il.algorithms.online.replay_buffer import Batch
from aerial_il.algorithms.run.cadence import Cadence
from aerial_il.algorithms.run.train_state import TrainState, adam
from aerial_il.core.checks import require_choice
from aerial_il.policies.squashed_gaussian import SquashedGaussianNetwork, log_density, unsquashed

RewardOn = Literal["state", "state_action"]


@dataclass(frozen=True, kw_only=True)
class AIRL(GAIL):
    """Adversarial inverse reinforcement learning (Fu et al. 2018): :class:`GAIL` with another discriminator.

    Attributes:
        reward_on: what g sees, ``state`` or ``state_action``.
    """

    name: ClassVar[str] = "airl"

    steps: int = 300_000
    bc_pretrain_steps: int = 0
    warmup: int = 0
    gamma: float = 0.99
    gae_lambda: float = 0.95
    lr: float = 3e-4
    clip: float = 0.2
    entropy: float = 0.0
    clip_norm: float = 0.5
    target_kl: float = 0.0
    critic_hidden: tuple[int, ...] = (64, 64)
    rollout: Rollout = Rollout(steps=2048, epochs=10, batch_size=64)
    reward: LearnedReward = LearnedReward(
        form="airl",
        hidden=(64, 64),
        lr=1e-3,
        updates=12,
        gradient_penalty=1.0,
        spectral_norm=False,
        dropout=0.0,
        action_noise=False,
    )
    reward_on: RewardOn = "state_action"
    reward_batch: int = 1024
    buffer_size: int = 16_384
    demonstrations: Demonstrations = Demonstrations(
        trajectories=None, subsample=1, bounds="environment", labels="executed", absorbing=True, control="none"
    )
    cadence: Cadence = Cadence(log_every=5_000, evaluate_every=0, checkpoint_every=50_000, keep_checkpoints=2)
    threads: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        require_choice(self, "reward_on", RewardOn)

    def build_reward_net(self, sizes: tuple[int, int], actor: SquashedGaussianNetwork) -> RewardNet:
        shape = self.reward.shape(running_norm=True, actions=self.reward_on == "state_action")
        return ShapedReward(*sizes, shape, lr=self.reward.lr, gamma=self.gamma, actor=actor)


class ShapedReward(RewardNet):
    """g as the network that is kept, h beside it, and the density of the policy as it stands.

    Args:
        obs_size, action_size, shape, lr: of g; see :class:`RewardNet`. gamma: discount. actor: the policy's.
    """

    def __init__(
        self, obs_size: int, action_size: int, shape: Shape, *, lr: float, gamma: float, actor: SquashedGaussianNetwork
    ) -> None:
        super().__init__(obs_size, action_size, shape, lr=lr)
        self._gamma, self._actor = gamma, actor
        plain = {"spectral": shape["spectral"], "dropout": shape["dropout"], "running_norm": True}
        self._height = Discriminator(obs_size + 1, shape["hidden"], **plain)
        both = nn.ModuleDict({"reward": self.network, "height": self._height})
        self._trained = TrainState(both, adam(both, lr))

    @torch.no_grad()
    def reward(self, obs: Tensor, actions: Tensor) -> Tensor:
        """Return ``g - log pi`` (B,): the shaping by h changes no advantage, and is left out."""
        return super().reward(obs, actions) - self._log_prob(obs, actions)

    def logits(self, expert: Batch, agent: Batch) -> tuple[Tensor, Tensor]:
        self._trained.network.train()
        of_expert, of_agent = self._sides(expert, agent)
        for norm, sides in ((self.network.norm, (of_expert, of_agent)), (self._height.norm, (expert.obs, agent.obs))):
            assert norm is not None
            norm.add(torch.cat(sides))
        return self._logit(expert, of_expert), self._logit(agent, of_agent)

    def _logit(self, batch: Batch, inputs: Tensor) -> Tensor:
        """Return ``g(s, a) + gamma h(s') - h(s) - log pi(a | s)`` (B,)."""
        shaping = self._gamma * batch.continues * self._height(batch.next_obs) - self._height(batch.obs)
        return self.network(inputs) + shaping - self._log_prob(batch.obs, batch.actions)

    @torch.no_grad()
    def _log_prob(self, obs: Tensor, actions: Tensor) -> Tensor:
        """Return ``log pi(a | s)`` (B,), 0 in the absorbing state, where there is nothing to choose."""
        raw = unsquashed(actions)
        density = log_density(raw, *self._actor.gaussian(obs[:, None, :-1])).sum(-1)
        return density * (1.0 - obs[:, -1])
