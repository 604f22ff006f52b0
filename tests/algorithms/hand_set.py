"""Networks with weights set by hand, so that what an equation makes of their answers can be computed by hand."""

import math
from collections.abc import Sequence

import torch

from aerial_il.algorithms.online.replay_buffer import Batch
from aerial_il.policies.parts.critics import Critics
from aerial_il.policies.squashed_gaussian import SquashedGaussian, SquashedGaussianNetwork

FAR = 100.0  # what inputs are raised by before the ReLU, and lowered by after it: all that is below counts as linear


@torch.no_grad()
def set_critics(critics: Critics, slopes: Sequence[Sequence[float]], offsets: Sequence[float]) -> None:
    """Let critic k answer ``slopes[k] @ (observation, mark, action) + offsets[k]``; each has one hidden unit."""
    into, out = critics.weights
    into.copy_(torch.tensor(slopes, dtype=torch.float32)[..., None].expand_as(into))
    out.fill_(1.0)
    critics.biases[0].fill_(FAR)
    critics.biases[1].copy_(torch.tensor(offsets, dtype=torch.float32)[:, None, None] - FAR)


def actor_at(centre: Sequence[float], log_std: float = -1.0) -> SquashedGaussianNetwork:
    """Return an actor with one hidden layer for observations of two elements, around ``centre`` whatever it sees."""
    actor = SquashedGaussian(hidden=(4,)).build(2, len(centre))
    move_actor(actor, centre, log_std)
    return actor


@torch.no_grad()
def move_actor(actor: SquashedGaussianNetwork, centre: Sequence[float], log_std: float = -1.0) -> None:
    """Let an actor answer actions around ``centre``, with that standard deviation before the tanh (``log_std``)."""
    assert actor.log_std is not None
    for layer in (actor.mean, actor.log_std):
        layer.weight.zero_()
    actor.mean.bias.copy_(torch.tensor([math.atanh(c) for c in centre]))
    actor.log_std.bias.fill_(log_std)


def step_of(
    actions: Sequence[float],
    *,
    rewards: float | Sequence[float] = 0.0,
    continues: float | Sequence[float] = 1.0,
    absorbed: bool = False,
) -> Batch:
    """Return transitions of one action element, from observations of zeros to others of ones, one per action.

    Args:
        actions: (B,). rewards, continues: (B,) or one number for all. absorbed: whether they led to an absorbing state.
    """
    count = len(actions)
    seen, led = torch.zeros(count, 3), torch.ones(count, 3)
    led[:, -1] = float(absorbed)
    each = (torch.as_tensor(value, dtype=torch.float32).expand(count) for value in (rewards, continues))
    return Batch(seen, torch.tensor(actions)[:, None], led, *each)
