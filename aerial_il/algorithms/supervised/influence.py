"""The influence of each demonstration on the success of flights that its clone has flown: which help, which harm.

Were a demonstration to count a little more in training, the weights would move along the gradient of its loss, through
the inverse Hessian of the training loss. How much likelier that makes the flights that succeeded, and unlikelier those
that failed, is its influence. With ``likelihood`` the negative loss of a flight stands for its log-likelihood: that is
the definition, and asks for flights with noise in their actions, for a clone that flies what it predicts is always at
its likeliest. With ``square`` the mean square of what the network answers takes the place of the loss, as in the
source's own code: demonstrations then count by where they were flown, as the network sees it, and not by what was done
there.

The Hessian is that of Gauss and Newton, of some windows of each demonstration; all gradients are sketched at random,
always with the same seed.

Source: C. Agia et al., "CUPID: Curating Data your Robot Loves with Influence Functions", 2025, definition 1 and
proposition 1; S. Park et al., "TRAK: Attributing Model Behavior at Scale", 2023, section 3, for the random projection;
X. Zheng et al., "Intriguing Properties of Data Attribution on Diffusion Models", 2024, for ``square``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from aerial_il.algorithms.supervised.training_set import TrainingSet, cut_windows
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.seeding import named_rng, torch_rng, torch_threads
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import masked_mean

Output = Literal["square", "likelihood"]
SKETCH = 2048  # numbers that are kept of a gradient
CURVED = 16  # windows of a demonstration that tell of the Hessian
DAMPING = 1.0  # of the Hessian, as a share of its mean eigenvalue in the sketch
AT_ONCE = 256  # windows


def influence(
    policy: ChunkPolicy, demos: Iterable[Episode], flights: Iterable[Episode], *, output: Output = "square"
) -> dict[str, float]:
    """Return uid -> influence of a step of each demonstration; below 0 is harm, 1 a usual size.

    Args:
        policy: as it was cloned. demos: that it was cloned from, or might be; each is read once, and some kilobytes are
            kept of it. flights: of its own, successes and failures, in its environment; each is read once.
        output: what of the network is differentiated.

    Raises:
        InvalidValueError: all flights succeed, or all fail, or are of another environment; or the policy does not fly
            what one network answers.
    """
    check_policy(policy)
    with torch_rng(0, "influence"), torch_threads(1):
        gradients = _Gradients(policy, output)
        ascent = _ascent(gradients, flights)
        uids, slopes, hessian = _descents(gradients, demos)
        damping = DAMPING * hessian.diagonal().mean() * torch.eye(SKETCH, dtype=hessian.dtype)
        scores = slopes @ torch.linalg.solve(hessian + damping, ascent)
    return dict(zip(uids, (scores / scores.square().mean().sqrt()).tolist(), strict=True))


def check_policy(policy: ChunkPolicy) -> None:
    """Raise :class:`InvalidValueError` unless a policy flies the one answer that its one network has."""
    name = policy.config.name if type(policy) is ChunkPolicy else type(policy).__name__
    if type(policy) is not ChunkPolicy or policy.network.noise_size or name == "categorical":
        raise InvalidValueError(
            f"policy={name} draws what it flies, or flies what several networks answer: what a demonstration does to "
            "its flights is not known. Influence is known of policy=mlp, act, recurrent, gaussian, squashed_gaussian."
        )


def _ascent(gradients: _Gradients, flights: Iterable[Episode]) -> Tensor:
    """Return the mean over flights of their sketched gradients (K,), each times by how much it exceeds mean success."""
    slopes, won = list[Tensor](), list[float]()
    for flight in flights:
        _require_same(gradients.policy, flight)
        windows = gradients.windows(replace(flight, expert_actions=np.full_like(flight.actions, np.nan)))
        slopes.append(gradients.mean(windows, np.arange(len(windows))))
        won.append(float(flight.success))
    if len({*won}) < 2:
        said = f"All {len(won)} flights {'succeed' if won[0] else 'fail'}" if won else "There is no flight"
        raise InvalidValueError(
            f"{said}: without successes and failures to compare, nothing has an influence. Fly more of them, or where "
            "more succeed or fail: aerial-il fly policy=RUN episodes=100 tier=gusts out=datasets/flown"
        )
    return (torch.tensor(won, dtype=torch.float64) - sum(won) / len(won)) @ torch.stack(slopes) / len(won)


def _require_same(policy: ChunkPolicy, flight: Episode) -> None:
    if differing := policy.spec.differences(flight.spec):
        raise InvalidValueError(
            f"{flight.uid} was flown in another environment than the policy was trained in: "
            f"{'; '.join(differing[:3])}. Fly the policy where it was trained: aerial-il fly policy=RUN out=PATH"
        )


def _descents(gradients: _Gradients, demos: Iterable[Episode]) -> tuple[list[str], Tensor, Tensor]:
    """Return names and sketched gradients (E, K) of the demonstrations, and the Hessian (K, K) of them all."""
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
    """Gradients by all weights of a policy's network, sketched: each weight is added to, or taken from, one number."""

    def __init__(self, policy: ChunkPolicy, output: Output) -> None:
        self.policy, self._output = policy, output
        self._weights = [weight for weight in policy.network.parameters() if weight.requires_grad]
        rng, count = named_rng(0, "influence"), sum(weight.numel() for weight in self._weights)
        self._places = torch.from_numpy(rng.integers(SKETCH, size=count))
        self._signs = torch.from_numpy(rng.choice(np.array([-1.0, 1.0], np.float32), count))

    def windows(self, episode: Episode) -> TrainingSet:
        """Return the windows of an episode as the network is shown them."""
        interface = self.policy.interface
        return TrainingSet(cut_windows([episode], interface.layout, self.policy.config), interface)

    def mean(self, windows: TrainingSet, index: np.ndarray) -> Tensor:
        """Return the gradient (K,) of the output's mean over the windows at ``index`` (B,)."""
        total = torch.zeros(SKETCH, dtype=torch.float64)
        for start in range(0, len(index), AT_ONCE):
            part = index[start : start + AT_ONCE]
            slopes = torch.autograd.grad(self._of(windows, part), self._weights)
            slope = torch.cat([each.flatten() for each in slopes]) * self._signs
            total.index_add_(0, self._places, slope.double(), alpha=len(part) / len(index))
        return total

    def _of(self, windows: TrainingSet, index: np.ndarray) -> Tensor:
        obs, actions, valid = windows.gather(index)
        if self._output == "likelihood":
            return self.policy.network.loss(obs, actions, valid)[0]
        return masked_mean(self.policy.network(obs).square(), valid)
