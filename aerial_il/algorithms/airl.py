"""Adversarial inverse reinforcement learning: imitation whose discriminator holds a reward that outlives the policy.

The loop is that of :mod:`aerial_il.algorithms.gail`; the discriminator is another one,

    ``logit = f(s, a, s') - log pi(a | s)``,  ``f = g(s, a) + gamma * h(s') - h(s)``,

with the policy's own density pi in it. At the optimum f is the demonstrator's advantage and, where g sees states alone
(``reward_on: state``) and the dynamics allow it, g its reward up to a constant. The policy is paid the logit, whose
density is an entropy bonus; what is kept with the run, and shown along an episode, is g.

It fails where demonstrations are few and the body has many joints (Ant, Walker2d for the peer), and where the density
of demonstrated actions at the edge of their bounds makes the logit arbitrary.

Source: J. Fu, K. Luo, S. Levine, "Learning Robust Rewards with Adversarial Inverse Reinforcement Learning", 2018,
equations 4 and 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import torch
from torch import Tensor, nn

from aerial_il.algorithms.adversarial.discriminator import Reward, Scorer, discriminator_loss
from aerial_il.algorithms.adversarial.reward_net import LearnedReward, Shape
from aerial_il.algorithms.gail import AdversarialImitation
from aerial_il.algorithms.rl.replay_buffer import Batch
from aerial_il.algorithms.rl.settings import require_choice
from aerial_il.algorithms.run.state import Trained, adam
from aerial_il.policies.squashed_gaussian import SquashedGaussian, log_density, unsquashed

RewardOn = Literal["state", "state_action"]


@dataclass(frozen=True, kw_only=True)
class AdversarialInverseLearning(AdversarialImitation):
    """Settings of a run; see :class:`AdversarialImitation`.

    Attributes:
        reward_on: what g sees, ``state`` or ``state_action``.
    """

    name: ClassVar[str] = "airl"

    reward: Reward = "airl"
    reward_on: RewardOn = "state_action"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_choice(self, "reward_on", RewardOn)

    def judge(self, sizes: tuple[int, int], actor: SquashedGaussian) -> LearnedReward:
        shape: Shape = {
            "hidden": self.reward_hidden,
            "spectral": self.spectral,
            "dropout": self.dropout,
            "running_norm": True,
            "actions": self.reward_on == "state_action",
            "form": self.reward,
        }
        return ShapedReward(*sizes, shape, lr=self.reward_lr, gamma=self.gamma, actor=actor)


class ShapedReward(LearnedReward):
    """g as the network that is kept, h beside it, and the density of the policy as it stands.

    Args:
        obs_size, action_size, shape, lr: of g; see :class:`LearnedReward`. gamma: discount. actor: the policy's.
    """

    def __init__(
        self, obs_size: int, action_size: int, shape: Shape, *, lr: float, gamma: float, actor: SquashedGaussian
    ) -> None:
        super().__init__(obs_size, action_size, shape, lr=lr)
        self._gamma, self._actor = gamma, actor
        plain = {"spectral": shape["spectral"], "dropout": shape["dropout"], "running_norm": True}
        self._height = Scorer(obs_size + 1, shape["hidden"], **plain)
        both = nn.ModuleDict({"reward": self.network, "height": self._height})
        self._trained = Trained(both, adam(both, lr))

    @torch.no_grad()
    def pay(self, obs: Tensor, actions: Tensor) -> Tensor:
        """Return ``g - log pi`` (B,): the shaping by h changes no advantage, and is left out."""
        return super().pay(obs, actions) - self._density(obs, actions)

    def learn(self, expert: Batch, agent: Batch, *, penalty: float) -> dict[str, float]:
        """Tell the demonstrator's transitions from the agent's a little better; ``penalty`` weighs the slope of g."""
        self._trained.network.train()
        shown, flown = (self._inputs(batch.obs, batch.actions) for batch in (expert, agent))
        for norm, inputs in ((self.network.norm, (shown, flown)), (self._height.norm, (expert.obs, agent.obs))):
            assert norm is not None
            norm.add(torch.cat(inputs))
        loss, metrics = discriminator_loss(self._logit(expert, shown), self._logit(agent, flown))
        return metrics | self._descend(loss, shown, flown, penalty)

    def _logit(self, batch: Batch, inputs: Tensor) -> Tensor:
        shaping = self._gamma * batch.going * self._height(batch.next_obs) - self._height(batch.obs)
        return self.network(inputs) + shaping - self._density(batch.obs, batch.actions)

    @torch.no_grad()
    def _density(self, obs: Tensor, actions: Tensor) -> Tensor:
        """Return ``log pi(a | s)`` (B,), 0 in the absorbing state, where there is nothing to choose."""
        raw = unsquashed(actions)
        found = log_density(raw, *self._actor.gaussian(obs[:, None, :-1])).sum(-1)
        return found * (1.0 - obs[:, -1])
