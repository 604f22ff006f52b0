"""Leading a chunk while it is denoised: to what is planned already, and to what the robot can follow.

A network that denoises has x = s a + n e, a share s of the actions a and n of noise e, and tells from it what a is. A
guide changes what it tells, at every step:

- real-time chunking: ``a_hat += min((s² + n²) / s, 10) J' W (y - a_hat)`` with y the plan that there is, W how much
  each of its actions is held, and J' the transposed Jacobian of a_hat by x: what y asks for goes back through the
  network, so that the rest of the chunk follows suit;
- embodiment: ``a_hat -= guidance s² g`` with g a clipped gradient, see :mod:`.embodiment`; only where s² is at least a
  half, for what is told earlier is told anew.

Source: K. Black, M. Galliker, S. Levine, "Real-Time Execution of Action Chunking Flow Policies", 2025, equations 2 to 5
(their weight, written for any s and n; their limit is 5); H. Gupta et al., "UMI-on-Air", 2025.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from aerial_il.core.tensors import tensor
from aerial_il.policies.parts.layout import Interface

LIMIT, MOSTLY = 10.0, 0.5
Denoise = Callable[[Tensor], Tensor]


@dataclass(frozen=True, eq=False)
class Guide:
    """Leads B chunks of C numbers each, normalised.

    Attributes:
        plan: (B, C) what is planned, and (B, C) how much each number of it is held, in [0, 1]; None for no plan.
        steer: (B, C) -> (B, C) what the chunk is changed by once all noise is gone; None for no change.
    """

    plan: tuple[Tensor, Tensor] | None = None
    steer: Callable[[Tensor], Tensor] | None = None

    def __call__(self, denoise: Denoise, x: Tensor, signal: float, noise: float) -> Tensor:
        """Return the actions (B, C) that are led to at ``x`` (B, C), of which ``denoise`` tells them alone."""
        clean = _joined(denoise, x, signal, noise, *self.plan) if self.plan else denoise(x)
        return clean + signal**2 * self.steer(clean) if self.steer and signal**2 >= MOSTLY else clean


def joining(interface: Interface, history: np.ndarray, plan: np.ndarray, known: np.ndarray, delay: int) -> Guide:
    """Return what leads new chunks to the plan that there is.

    Args:
        interface: of the policy. history: (B, To, Do) that it sees.
        plan: (B, Ta, Da) actions from the moment of the observation on, the first ``delay`` of them sent.
        known: (B, Ta) bool, where there is one.
    """
    wanted = interface.encode_actions(plan.astype(np.float32), history)
    held = np.repeat(soft_mask(known, delay)[..., None], wanted.shape[-1], -1)
    planned, kept = (tensor(each.reshape(len(plan), -1).astype(np.float32)) for each in (wanted, held))
    return Guide(plan=(planned, kept))


def soft_mask(known: np.ndarray, delay: int) -> np.ndarray:
    """Return how much each planned action is held (B, Ta): 1 where it was sent, then falling exponentially to 0."""
    step, end = np.arange(known.shape[1]), known.sum(1, keepdims=True)
    left = np.clip((end - step) / np.maximum(end - delay + 1, 1), 0.0, 1.0)
    return known * np.where(step < delay, 1.0, left * np.expm1(left) / (np.e - 1))


def _joined(denoise: Denoise, x: Tensor, signal: float, noise: float, planned: Tensor, held: Tensor) -> Tensor:
    """Return what ``denoise`` tells of ``x``, pulled to the plan as far as that is held."""
    with torch.enable_grad():
        x = x.detach().requires_grad_()
        clean = denoise(x)
    (pull,) = torch.autograd.grad(clean, x, held * (planned - clean.detach()))
    weight = min((signal**2 + noise**2) / signal, LIMIT) if signal else LIMIT
    return clean.detach() + weight * pull
