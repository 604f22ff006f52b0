"""Demonstrated actions with the noise of an agent, so that a discriminator cannot tell one from the other by it."""

from __future__ import annotations

import torch

from aerial_il.algorithms.online.replay_buffer import Batch, ReplayBuffer
from aerial_il.policies.squashed_gaussian import SquashedGaussianNetwork, unsquashed


def sample_demos(
    expert_buffer: ReplayBuffer, count: int, actor: SquashedGaussianNetwork, *, action_noise: bool
) -> Batch:
    """Draw ``count`` demonstrated transitions for a discriminator, with the noise of ``actor`` if asked for."""
    demos = expert_buffer.sample(count)
    return with_action_noise(demos, actor) if action_noise else demos


@torch.no_grad()
def with_action_noise(demos: Batch, actor: SquashedGaussianNetwork) -> Batch:
    """Return ``demos`` with the noise on their actions that ``actor`` would have added to them."""
    _, log_std = actor.gaussian(demos.obs[:, None, :-1])
    raw = unsquashed(demos.actions)
    return demos._replace(actions=torch.tanh(raw + log_std.exp() * torch.randn_like(raw)))
