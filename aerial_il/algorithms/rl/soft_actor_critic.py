"""Off-policy reinforcement learning on minibatches, wherever these and their rewards come from.

The critics learn ``Q(s, a) = r + gamma * (min Q'(s', a') - alpha log pi(a'|s'))``, the actor to maximise
``min Q - alpha log pi``, and alpha is moved so that the entropy stays near its target. In the absorbing state there is
one action, zero, and no entropy.

Source: T. Haarnoja et al., "Soft Actor-Critic Algorithms and Applications", 2018; I. Kostrikov et al.,
"Discriminator-Actor-Critic", 2019, for the absorbing state.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from aerial_il.algorithms.rl.pretraining import away_from, clone
from aerial_il.algorithms.rl.replay_buffer import Batch, Replay
from aerial_il.algorithms.run.state import Snapshot, Trained, adam, below
from aerial_il.core.tensors import tensor
from aerial_il.policies.squashed_gaussian import SquashedGaussian

CRITICS = 2


class Critics(nn.Module):
    """Two perceptrons side by side, each layer one multiplication: (B, Do + 1), (B, Da) -> (2, B)."""

    def __init__(self, inputs: int, hidden: Sequence[int]) -> None:
        super().__init__()
        self.weights, self.biases = nn.ParameterList(), nn.ParameterList()
        for a, b in pairwise((inputs, *hidden, 1)):
            bound = 1.0 / math.sqrt(a)
            self.weights.append(nn.Parameter(torch.empty(CRITICS, a, b).uniform_(-bound, bound)))
            self.biases.append(nn.Parameter(torch.empty(CRITICS, 1, b).uniform_(-bound, bound)))

    def forward(self, obs: Tensor, actions: Tensor) -> Tensor:
        x = torch.cat([obs, actions], dim=-1).expand(CRITICS, -1, -1)
        *hidden, last = zip(self.weights, self.biases, strict=True)
        for weight, bias in hidden:
            x = torch.relu(torch.baddbmm(bias, x, weight))
        return torch.baddbmm(last[1], x, last[0])[..., 0]


class SoftActorCritic:
    """Actor, critics, slowly following targets and the temperature alpha.

    Args:
        actor: the policy's network.
        obs_size, action_size: Do and Da.
        hidden: widths of the critics.
        lr: learning rate of all, until :meth:`learn_at` is called.
        gamma: discount. tau: share by which the targets follow at each update.
        entropy: wanted entropy for each action element, of the squashed distribution.
        alpha: temperature at the start.
        actor_every: updates of the critics for each one of actor and temperature.
    """

    def __init__(
        self,
        actor: SquashedGaussian,
        obs_size: int,
        action_size: int,
        *,
        hidden: Sequence[int],
        lr: float,
        gamma: float,
        tau: float,
        entropy: float,
        alpha: float,
        actor_every: int = 1,
    ) -> None:
        self.network, self.gamma, self.tau = actor, gamma, tau
        self._wanted, self._actor_every, self._updates = entropy * action_size, actor_every, 0
        critics = Critics(obs_size + 1 + action_size, hidden)
        temperature = nn.ParameterList([nn.Parameter(torch.tensor(math.log(alpha)))])
        self._log_alpha = temperature[0]
        improved = nn.ModuleDict({"policy": actor, "temperature": temperature})
        self._actor, self._critics = Trained(improved, adam(improved, lr)), Trained(critics, adam(critics, lr))
        self._targets = copy.deepcopy(critics).requires_grad_(False)
        self._pairs = list(zip(self._targets.parameters(), critics.parameters(), strict=True))

    @torch.no_grad()
    def explore(self, obs: np.ndarray) -> np.ndarray:
        """Draw actions (n, Da) for encoded observations (n, Do)."""
        return self.network.sample(tensor(obs)[:, None])[0].numpy()

    def learn_at(self, lr: float) -> None:
        """Let all that follows be learned at the rate ``lr``."""
        for part in (self._actor, self._critics):
            part.learn_at(lr)

    def clone(self, shown: Replay, steps: int, batch_size: int) -> None:
        """Move the actor's centre towards demonstrated actions in ``steps`` minibatches: another place to begin."""
        clone(self._actor, self.network, shown, steps=steps, batch_size=batch_size)

    def update(
        self, batch: Batch, *, shown: Batch | None = None, nearness: float = 0.0, improve: bool = True
    ) -> dict[str, float]:
        """Take one step of critics and targets and, where it is due, of actor and temperature.

        Args:
            batch: what all of them learn from.
            shown: demonstrations that the actor is drawn to as well, with weight ``nearness``.
            improve: whether the actor moves at all; critics alone learn what a policy is worth.
        """
        wanted = self._target(batch)
        values = self._critics.network(batch.obs, batch.actions)
        loss = ((values - wanted) ** 2).mean(1).sum()
        self._critics.descend(loss)
        self._updates += 1
        metrics = {"critic/loss": loss.item(), "critic/value": values.mean().item()}
        if improve and self._updates % self._actor_every == 0:
            metrics |= self._improve(batch, nearness * away_from(self.network, shown) if shown is not None else 0.0)
        self._follow()
        return metrics

    def _improve(self, batch: Batch, away: Tensor | float) -> dict[str, float]:
        """Take one step of actor and temperature, leaving out the absorbing state, where nothing is to be chosen."""
        alive = 1.0 - batch.obs[:, -1]
        share, alpha = alive / alive.sum().clamp(min=1.0), self._log_alpha.detach().exp()
        actions, _, surprise = self.network.sample(batch.obs[:, None, :-1])
        worth = self._critics.network(batch.obs, actions).min(0).values
        loss = (share * (alpha * surprise - worth)).sum()
        entropy = -(share * surprise.detach()).sum()
        temperature = self._log_alpha * (entropy - self._wanted)
        self._actor.descend(loss + away + temperature)  # the first two move the actor alone, the last alpha alone
        return {"actor/loss": loss.item(), "actor/entropy": entropy.item(), "actor/alpha": alpha.item()}

    @torch.no_grad()
    def _target(self, batch: Batch) -> Tensor:
        alive = 1.0 - batch.next_obs[:, -1]
        actions, _, surprise = self.network.sample(batch.next_obs[:, None, :-1])
        worth = self._targets(batch.next_obs, alive[:, None] * actions).min(0).values
        return batch.rewards + self.gamma * batch.going * (worth - self._log_alpha.exp() * alive * surprise)

    @torch.no_grad()
    def _follow(self) -> None:
        for target, current in self._pairs:
            target.lerp_(current, self.tau)

    def snapshot(self) -> Snapshot:
        parts = {"actor": self._actor, "critics": self._critics}
        arrays = {f"{name}.{key}": a for name, part in parts.items() for key, a in part.snapshot().arrays.items()}
        targets = {f"targets.{name}": value.numpy() for name, value in self._targets.state_dict().items()}
        return Snapshot({**arrays, **targets}, {"updates": self._updates})

    def restore(self, saved: Snapshot) -> None:
        for name, part in {"actor": self._actor, "critics": self._critics}.items():
            part.restore(Snapshot(below(f"{name}.", saved.arrays)))
        self._updates = saved.values["updates"]
        targets = below("targets.", saved.arrays)
        self._targets.load_state_dict({name: torch.from_numpy(a.copy()) for name, a in targets.items()})
