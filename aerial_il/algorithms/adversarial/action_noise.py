"""Demonstrated actions with the noise of an agent, so that a discriminator cannot tell one from the other by it."""

from __future__ import annotations

import torch

from aerial_il.algorithms.rl.replay_buffer import Batch, Replay
from aerial_il.policies.squashed_gaussian import SquashedGaussian, unsquashed


def sample_shown(expert: Replay, count: int, actor: SquashedGaussian, *, blur: bool) -> Batch:
    """Draw ``count`` demonstrated transitions for a discriminator, with the noise of ``actor`` if ``blur``."""
    shown = expert.sample(count)
    return blurred(shown, actor) if blur else shown


@torch.no_grad()
def blurred(shown: Batch, actor: SquashedGaussian) -> Batch:
    """Return ``shown`` with the noise on its actions that ``actor`` would have added to them."""
    _, log_std = actor.gaussian(shown.obs[:, None, :-1])
    raw = unsquashed(shown.actions)
    return shown._replace(actions=torch.tanh(raw + log_std.exp() * torch.randn_like(raw)))
