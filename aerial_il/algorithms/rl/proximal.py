"""On-policy reinforcement learning on one rollout at a time, wherever its rewards come from.

Source: J. Schulman et al., "Proximal Policy Optimization Algorithms", 2017, equation 7.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from aerial_il.algorithms.rl.pretraining import clone
from aerial_il.algorithms.rl.replay_buffer import Replay
from aerial_il.algorithms.run.state import Snapshot, Trained, adam, below
from aerial_il.core.tensors import tensor
from aerial_il.policies.squashed_gaussian import SquashedGaussian, log_density


class Critic(nn.Module):
    """A perceptron with tanh from observations (B, Do) to values (B,)."""

    def __init__(self, inputs: int, hidden: Sequence[int]) -> None:
        super().__init__()
        parts = [part for a, b in pairwise((inputs, *hidden)) for part in (nn.Linear(a, b), nn.Tanh())]
        self.layers = nn.Sequential(*parts, nn.Linear(hidden[-1], 1))

    def forward(self, obs: Tensor) -> Tensor:
        return self.layers(obs)[..., 0]


class Proximal:
    """Actor and critic, moved by several passes over a rollout, the actor never far from where it acted.

    Args:
        actor: the policy's network.
        obs_size: Do.
        hidden: widths of the critic.
        lr: learning rate of both.
        clip: how far the ratio of probabilities counts, 1 ± clip.
        epochs: passes over a rollout. batch_size: transitions in a minibatch.
        entropy: weight of the Gaussian's entropy, before the tanh, in the actor's loss.
        clip_norm: largest gradient norm of each network.
        target_kl: a pass in which the actor has moved further than 1.5 times this is its last; 0 for no limit.
    """

    def __init__(
        self,
        actor: SquashedGaussian,
        obs_size: int,
        *,
        hidden: Sequence[int],
        lr: float,
        clip: float,
        epochs: int,
        batch_size: int,
        entropy: float,
        clip_norm: float,
        target_kl: float,
    ) -> None:
        self.network, critic = actor, Critic(obs_size, hidden)
        self._actor, self._critic = Trained(actor, adam(actor, lr)), Trained(critic, adam(critic, lr))
        self.lr, self.clip, self.epochs, self.batch_size = lr, clip, epochs, batch_size
        self.entropy, self.clip_norm, self.target_kl = entropy, clip_norm, target_kl

    @torch.no_grad()
    def explore(self, obs: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Draw actions (n, Da), their forms before the tanh (n, Da) and log densities (n,) for observations (n, Do)."""
        drawn = self.network.sample(tensor(obs)[:, None])
        return drawn[0].numpy(), drawn[1].numpy(), drawn[2].numpy()

    @torch.no_grad()
    def values(self, obs: np.ndarray) -> np.ndarray:
        """Return what the critic expects (...) from encoded observations (..., Do)."""
        return self._critic.network(tensor(obs)).numpy()

    def clone(self, shown: Replay, steps: int) -> None:
        """Move the actor's centre towards demonstrated actions in ``steps`` minibatches: another place to begin."""
        clone(self._actor, self.network, shown, steps=steps, batch_size=self.batch_size)

    def update(
        self,
        obs: np.ndarray,
        raw: np.ndarray,
        advantages: np.ndarray,
        values: np.ndarray,
        *,
        left: float,
        improve: bool = True,
    ) -> dict[str, float]:
        """Learn from one rollout.

        Args:
            obs: (N, Do) encoded. raw: (N, Da) actions before the tanh. advantages: (N,). values: (N,) critic's targets.
            left: share of the training that is left; the learning rate follows it.
            improve: whether the actor moves at all; the critic alone learns what it is worth.
        """
        for part in (self._actor, self._critic):
            part.learn_at(self.lr * left)
        seen, drawn, gains, wanted = (tensor(np.asarray(a, np.float32)) for a in (obs, raw, advantages, values))
        with torch.no_grad():
            before = self._log_density(seen, drawn)
        passes: list[np.ndarray] = []
        moving = improve
        for _ in range(self.epochs):
            order = shuffled(len(before), self.batch_size)
            rows = [self._descend(seen[i], drawn[i], gains[i], wanted[i], before[i], moving) for i in order]
            passes.append(np.mean(rows, axis=0))
            moving = moving and not (self.target_kl and passes[-1][2] > 1.5 * self.target_kl)
        means = np.mean(passes, axis=0)
        return dict(zip(("actor/loss", "critic/loss", "actor/moved", "actor/clipped"), map(float, means), strict=True))

    def _descend(
        self, obs: Tensor, raw: Tensor, advantages: Tensor, values: Tensor, before: Tensor, moving: bool
    ) -> tuple[float, ...]:
        critic_loss = ((self._critic.network(obs) - values) ** 2).mean()
        self._critic.descend(critic_loss, clip_norm=self.clip_norm)
        mean, log_std = self.network.gaussian(obs[:, None])
        log_ratio = log_density(raw, mean, log_std).sum(-1) - before
        ratio = log_ratio.exp()
        gain = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        kept = torch.minimum(ratio * gain, ratio.clamp(1 - self.clip, 1 + self.clip) * gain)
        actor_loss = -kept.mean() - self.entropy * log_std.sum(-1).mean()
        if moving:
            self._actor.descend(actor_loss, clip_norm=self.clip_norm)
        with torch.no_grad():
            moved = (ratio - 1 - log_ratio).mean().item()
            clipped = ((ratio - 1).abs() > self.clip).float().mean().item()
        return actor_loss.item(), critic_loss.item(), moved, clipped

    def _log_density(self, obs: Tensor, raw: Tensor) -> Tensor:
        return log_density(raw, *self.network.gaussian(obs[:, None])).sum(-1)

    def snapshot(self) -> Snapshot:
        parts = {"actor": self._actor, "critic": self._critic}
        return Snapshot({f"{n}.{k}": a for n, part in parts.items() for k, a in part.snapshot().arrays.items()})

    def restore(self, saved: Snapshot) -> None:
        for name, part in {"actor": self._actor, "critic": self._critic}.items():
            part.restore(Snapshot(below(f"{name}.", saved.arrays)))


def shuffled(count: int, batch_size: int) -> list[Tensor]:
    """Return minibatches of row numbers in random order; a last row left alone, which has no spread, joins others."""
    parts = list(torch.randperm(count).split(batch_size))
    if len(parts) > 1 and len(parts[-1]) == 1:
        parts[-2:] = [torch.cat(parts[-2:])]
    return parts
