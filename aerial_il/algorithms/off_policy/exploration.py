"""Who explores: random actions, or a deterministic policy with noise, independent from step to step or correlated."""

import math
from typing import Protocol

import numpy as np
import torch

from aerial_il.algorithms.run.state import Part, Snapshot
from aerial_il.core.tensors import tensor
from aerial_il.policies.squashed_gaussian import SquashedGaussianNetwork


class Explorer(Protocol):
    """Samples normalised actions (n, Da) for encoded observations (n, Do)."""

    def explore(self, obs: np.ndarray) -> np.ndarray: ...


class RandomActions(Part):
    """Samples actions uniformly from [-1, 1], whatever is observed.

    Args:
        size: elements Da of an action. rng: samples them.
    """

    changing = ("_rng",)

    def __init__(self, size: int, rng: np.random.Generator) -> None:
        self._size, self._rng = size, rng

    def explore(self, obs: np.ndarray) -> np.ndarray:
        return self._rng.uniform(-1, 1, (len(obs), self._size))


class ExplorationNoise:
    """Gaussian noise, equally large in every step, of which a share ``correlation`` stays from step to step:

        ``e_t = rho e_{t-1} + sqrt(1 - rho^2) sigma eps_t``.

    Where a single action moves little, as with a car that must rock itself out of a valley, independent noise averages
    out before anything happens. Correlated noise is an Ornstein-Uhlenbeck process (G. Uhlenbeck, L. Ornstein, "On the
    Theory of the Brownian Motion", 1930), sampled at the control steps; T. Lillicrap et al., 2016, section 7, explore
    with rho = 0.85.

    Args:
        deviation: the standard deviation sigma, in actions normalised to [-1, 1].
        correlation: rho, from 0 to below 1; the noise of a world runs on into its next episode.
    """

    def __init__(self, deviation: float, correlation: float = 0.0) -> None:
        self._deviation, self._correlation = deviation, correlation
        self._last: torch.Tensor | None = None

    @torch.no_grad()
    def explore(self, actor: SquashedGaussianNetwork, obs: np.ndarray) -> np.ndarray:
        """Return the mean actions (n, Da) of ``actor`` for encoded observations (n, Do), with noise added."""
        actions = actor(tensor(obs)[:, None])[:, 0]
        return (actions + self._deviation * self._drawn(actions)).clamp(-1, 1).numpy()

    def _drawn(self, actions: torch.Tensor) -> torch.Tensor:
        white = torch.randn_like(actions)
        if self._correlation == 0.0:
            return white
        anew = math.sqrt(1.0 - self._correlation**2)
        self._last = white if self._last is None else self._correlation * self._last + anew * white
        return self._last

    def snapshot(self) -> Snapshot:
        return Snapshot({} if self._last is None else {"last": self._last.numpy().copy()})

    def restore(self, saved: Snapshot) -> None:
        last = saved.arrays.get("last")
        self._last = None if last is None else torch.from_numpy(last.copy())
