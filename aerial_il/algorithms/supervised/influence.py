"""The influence of each demonstration on the success of flights that its clone has flown: which help, which harm.

Were a demonstration to count a little more in training, the weights would move along the gradient of its loss, through
the inverse Hessian of the training loss. How much likelier that makes the flights that succeeded, and unlikelier those
that failed, is its influence. The negative loss of a flight stands for its log-likelihood; the Hessian is that of Gauss
and Newton, of some windows of each demonstration; all gradients are sketched at random, with the same seed always.

Source: C. Agia et al., "CUPID: Curating Data your Robot Loves with Influence Functions", 2025, definition 1 and
proposition 1; S. Park et al., "TRAK: Attributing Model Behavior at Scale", 2023, section 3, for the random projection.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from aerial_il.algorithms.supervised.training_set import TrainingSet, cut_windows
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.seeding import named_rng, torch_rng, torch_threads
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.chunk_policy import ChunkPolicy

SKETCH = 2048  # numbers that are kept of a gradient
CURVED = 16  # windows of a demonstration that tell of the Hessian
DAMPING = 0.1  # of the Hessian, as a share of its mean eigenvalue in the sketch
AT_ONCE = 256  # windows


def influence(policy: ChunkPolicy, demos: Iterable[Episode], flights: Iterable[Episode]) -> dict[str, float]:
    """Return uid -> influence of each demonstration; 1 is a usual size of it, below 0 is harm.

    Args:
        policy: as it was cloned. demos: it was cloned from, or might be; each is read once. flights: of its own,
            successes and failures, in its environment; each is read once.

    Raises:
        InvalidValueError: all flights succeed, or all fail, or are of another environment; or the policy has no loss
            for what it was shown.
    """
    check_policy(policy)
    with torch_rng(0, "influence"), torch_threads(1):
        gradients = _Gradients(policy)
        ascent = _ascent(gradients, flights)
        uids, slopes, hessian = _descents(gradients, demos)
    damped = hessian + DAMPING * hessian.diagonal().mean() * torch.eye(SKETCH, dtype=hessian.dtype)
    scores = -(slopes @ torch.linalg.solve(damped, ascent)).numpy()
    return dict(zip(uids, (scores / max(np.sqrt(np.mean(scores**2)), 1e-30)).tolist(), strict=True))


def check_policy(policy: ChunkPolicy) -> None:
    """Raise :class:`InvalidValueError` unless what a policy flies is the answer of one network with a loss."""
    if type(policy) is not ChunkPolicy:
        raise InvalidValueError(
            f"{type(policy).__name__} flies what several networks answer, and has no loss of its own for what it flew. "
            "Influence is known of policies that aerial-il train has cloned: policy=mlp, act, diffusion and the others."
        )


def _ascent(gradients: _Gradients, flights: Iterable[Episode]) -> Tensor:
    """Return the sketched gradient (K,) of the expected success."""
    slopes, won = list[Tensor](), list[float]()
    for flight in flights:
        _require_same(gradients.policy, flight)
        slopes.append(-gradients.of(replace(flight, expert_actions=np.full_like(flight.actions, np.nan))))
        won.append(float(flight.success))
    if not 0 < sum(won) < len(won):
        all_ = "There is no flight" if not won else f"All {len(won)} flights {'succeed' if won[0] else 'fail'}"
        raise InvalidValueError(
            f"{all_}: without successes and failures to compare, nothing has an influence. Fly more, or in a rougher "
            "tier where some fail: aerial-il fly policy=RUN episodes=100 tier=gusts out=datasets/flown"
        )
    better = torch.tensor(won, dtype=torch.float64) - np.mean(won)
    return better @ torch.stack(slopes) / len(won)


def _descents(gradients: _Gradients, demos: Iterable[Episode]) -> tuple[list[str], Tensor, Tensor]:
    """Return names and sketched gradients (E, K) of the demonstrations' losses, and the Hessian (K, K) of them all."""
    uids, slopes, hessian, steps = list[str](), list[Tensor](), torch.zeros(SKETCH, SKETCH, dtype=torch.float64), 0
    for demo in demos:
        windows = gradients.windows(demo)
        uids.append(demo.uid)
        slopes.append(gradients.mean(windows, np.arange(len(windows))))
        chosen = np.linspace(0, len(windows) - 1, CURVED).round().astype(int)
        single = torch.stack([gradients.mean(windows, chosen[i : i + 1]) for i in range(CURVED)])
        hessian.addmm_(single.T, single, alpha=len(windows) / CURVED)
        steps += len(windows)
    return uids, torch.stack(slopes), hessian / steps


class _Gradients:
    """Gradients of a policy's loss by all weights of its network, sketched to K numbers.

    Each weight is added to one of them, or taken from it.
    """

    def __init__(self, policy: ChunkPolicy) -> None:
        self.policy = policy
        self._weights = [weight for weight in policy.network.parameters() if weight.requires_grad]
        rng, count = named_rng(0, "influence"), sum(weight.numel() for weight in self._weights)
        self._places = torch.from_numpy(rng.integers(SKETCH, size=count))
        self._signs = torch.from_numpy(rng.choice(np.array([-1.0, 1.0], np.float32), count))

    def windows(self, episode: Episode) -> TrainingSet:
        """Return the windows of an episode as the network is shown them."""
        interface = self.policy.interface
        return TrainingSet(cut_windows([episode], interface.layout, self.policy.config), interface)

    def mean(self, windows: TrainingSet, index: np.ndarray) -> Tensor:
        """Return the gradient (K,) of the mean loss of the windows at ``index`` (B,)."""
        total = torch.zeros(SKETCH, dtype=torch.float64)
        for start in range(0, len(index), AT_ONCE):
            part = index[start : start + AT_ONCE]
            loss, _ = self.policy.network.loss(*windows.gather(part))
            slope = torch.cat([each.flatten() for each in torch.autograd.grad(loss, self._weights)])
            total.index_add_(0, self._places, (slope * self._signs).double(), alpha=len(part) / len(index))
        return total


def _require_same(policy: ChunkPolicy, flight: Episode) -> None:
    if differing := policy.spec.differences(flight.spec):
        raise InvalidValueError(
            f"{flight.uid} was flown in another environment than the policy was trained in: "
            f"{'; '.join(differing[:3])}. Fly the policy where it was trained: aerial-il fly policy=RUN out=PATH"
        )
