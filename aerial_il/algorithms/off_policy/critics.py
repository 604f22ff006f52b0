"""What action-value critics and actors learn, where several algorithms mean the same."""

from __future__ import annotations

from torch import Tensor

from aerial_il.algorithms.online.replay_buffer import Batch
from aerial_il.algorithms.online.smoothness import Smoothness
from aerial_il.policies.parts.critics import Critics
from aerial_il.policies.squashed_gaussian import SquashedGaussianNetwork, unsquashed


def squared_error(
    critics: Critics, batch: Batch, targets: Tensor, *, spread: bool = False
) -> tuple[Tensor, dict[str, float]]:
    """Return ``mean (Q(s, a) - y)^2``, summed over the critics, for ``targets`` y (B,); and named numbers.

    Args:
        spread: whether the standard deviation over the critics is among them.
    """
    values = critics(batch.obs, batch.actions)
    loss = ((values - targets) ** 2).mean(1).sum()
    means = {"critic/loss": loss.item(), "critic/value": values.mean().item()}
    if spread:
        means["critic/spread"] = values.detach().std(0, correction=0).mean().item()
    return loss, means


def ascent(actor: SquashedGaussianNetwork, critics: Critics, batch: Batch, smoothness: Smoothness) -> Tensor:
    """Return ``-mean Q1(s, mu(s))`` of a deterministic actor mu and the first critic, plus the smoothness loss."""
    obs = batch.obs[:, :-1]
    values = critics(batch.obs, actor(obs[:, None])[:, 0])[0]
    return -values.mean() + smoothness.loss(actor, obs, batch.next_obs[:, :-1])


def weighted_likelihood(
    actor: SquashedGaussianNetwork, batch: Batch, weights: Tensor, advantages: Tensor
) -> tuple[Tensor, dict[str, float]]:
    """Return ``-mean w log pi(a | s)`` without the absorbing state, where no action is chosen; and named numbers.

    Args:
        weights, advantages: (B,) of the actions.
    """
    alive = 1.0 - batch.obs[:, -1]
    share = alive / alive.sum().clamp(min=1.0)
    log_prob, _ = actor.judge(batch.obs[:, None, :-1], unsquashed(batch.actions))
    loss = -(share * weights * log_prob).sum()
    means = {"actor/advantage": (share * advantages).sum().item(), "actor/weight": (share * weights).sum().item()}
    return loss, {"actor/loss": loss.item(), **means}
