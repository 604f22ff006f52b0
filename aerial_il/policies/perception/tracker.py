"""What was told, kept over time and over cameras, for n worlds.

A place is followed under two hypotheses, that it rests in the world and that it moves with the tool, each a Kalman
filter; how likely each is follows from what they predict (interacting multiple models). So nothing says when something
has been grasped: the images do. A field whose rate is wanted, too, goes on at that rate, which its changes tell: a
Kalman filter of both. All other fields drift as much as they did in the demonstrations. The errors of one frame are
much like those of the next, so that what is known is forgotten a little with each.

Source: H. Blom and Y. Bar-Shalom, "The Interacting Multiple Model Algorithm for Systems with Markovian Switching
Coefficients", 1988.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from aerial_il.policies.perception.relations import Rate
from aerial_il.policies.perception.targets import PLACE, Target

SWITCH = 0.02  # chance, from one frame to the next, that what rested moves with the tool, or the other way round
FAR = 9.0  # squared distance, in deviations, beyond which a measurement weighs less
LEAST_M = 1e-3  # deviation that a place is never known better than
DOUBTED = 0.8  # share of what is known that is kept where a place should be in an image, and is not
UNKNOWN = 2.0  # deviations of the demonstrations, by which nothing is known


class Tracker:
    """Estimates of all targets.

    Args:
        targets: what is followed. forget: share of what is known that is kept from one frame to the next.
        rates: of some of them that are wanted, too.
    """

    def __init__(self, targets: Sequence[Target], forget: float, rates: Sequence[Rate] = ()) -> None:
        self.targets, self._rates = tuple(targets), tuple(rates)
        moving = {
            rate.of: _Moving(target, forget, rate) for rate in rates for target in targets if target.field == rate.of
        }
        still = {each.field: (_Place if each.kind == PLACE else _Numbers)(each, forget) for each in targets}
        self._filters: dict[str, _Place | _Numbers | _Moving] = {**still, **moving}

    def begin(self, mask: np.ndarray) -> None:
        """Know nothing of the worlds in ``mask`` (n,) bool but what is ordinary."""
        for each in self._filters.values():
            each.begin(mask)

    def move(self, turn: np.ndarray, before: np.ndarray, after: np.ndarray) -> None:
        """Let a step pass in which the tools turned by ``turn`` (n, 3, 3), world, and went from one place to another.

        Args:
            before, after: (n, 3) m.
        """
        for each in self._filters.values():
            each.move(turn, before, after)

    def fade(self, mask: np.ndarray) -> None:
        """Forget a little, before what a frame tells in the worlds of ``mask`` (n,) bool."""
        for each in self._filters.values():
            each.fade(mask)

    def tell(
        self,
        field: str,
        mask: np.ndarray,
        values: np.ndarray,
        spread: np.ndarray,
        *,
        carried: np.ndarray | None = None,
        age: np.ndarray | None = None,
    ) -> None:
        """Take in what a camera tells of a field in the worlds of ``mask`` (n,) bool.

        Args:
            values: (n, D), as they were when the image was taken.
            spread: (n, 3, 3) covariances of a place, (n, D) variances of others.
            carried: (n, 3) where a place is now if the tool has carried it since the image was taken; None for then.
            age: (n,) control steps since then; None for none.
        """
        if isinstance(each := self._filters[field], _Moving):
            each.tell(mask, values, spread, np.zeros(len(mask)) if age is None else age)
        else:
            each.tell(mask, values, spread, values if carried is None else carried)

    def doubt(self, field: str, mask: np.ndarray) -> None:
        """Know less of a place in the worlds of ``mask`` (n,) bool: where it should be in an image, it is not."""
        self._filters[field].doubt(mask)

    def estimate(self, field: str) -> np.ndarray:
        """Return one estimate (n, D) as it is."""
        return self._filters[field].estimate()

    def estimates(self) -> dict[str, np.ndarray]:
        """Return ``field -> (n, D)``."""
        told = {each.field: each.straightened(self._filters[each.field].estimate()) for each in self.targets}
        return told | {each.field: self._filters[each.of].mean[..., 1] for each in self._rates}

    def deviations(self) -> dict[str, np.ndarray]:
        """Return ``field -> (n,)``, how sure each estimate is: root mean square over its numbers, in its unit."""
        return {name: each.deviation() for name, each in self._filters.items()}

    def memory(self) -> dict[str, np.ndarray]:
        """Return copies of all that is known."""
        return {
            f"{name}.{key}": value.copy()
            for name, each in self._filters.items()
            for key, value in vars(each).items()
            if isinstance(value, np.ndarray)
        }

    def recall(self, memory: Mapping[str, np.ndarray]) -> None:
        """Know what :meth:`memory` returned."""
        for name, each in self._filters.items():
            for key in [key for key, value in vars(each).items() if isinstance(value, np.ndarray)]:
                setattr(each, key, memory[f"{name}.{key}"].copy())


class _Numbers:
    """A field that is no place: a mean and a variance for each of its numbers."""

    def __init__(self, target: Target, forget: float) -> None:
        self._target, self._keep = target, forget
        self.mean, self.var = np.zeros((0, target.size)), np.zeros((0, target.size))

    def begin(self, mask: np.ndarray) -> None:
        if len(self.mean) != len(mask):
            self.mean, self.var = np.zeros((len(mask), self._target.size)), np.zeros((len(mask), self._target.size))
        self.mean[mask], self.var[mask] = self._target.centre, np.square(UNKNOWN * self._target.scale)

    def move(self, turn: np.ndarray, before: np.ndarray, after: np.ndarray) -> None:
        self.var += self._target.drift

    def fade(self, mask: np.ndarray) -> None:
        self.var[mask] = np.minimum(self.var[mask] / self._keep, np.square(UNKNOWN * self._target.scale))

    def tell(self, mask: np.ndarray, values: np.ndarray, spread: np.ndarray, carried: np.ndarray) -> None:
        missed, var = values[mask] - self.mean[mask], self.var[mask]
        far = np.square(missed) / (var + spread[mask])
        gain = var / (var + spread[mask] * np.maximum(1.0, far / FAR))
        self.mean[mask] += gain * missed
        self.var[mask] = (1.0 - gain) * var

    def doubt(self, mask: np.ndarray) -> None:
        self.var[mask] = np.minimum(self.var[mask] / DOUBTED, np.square(UNKNOWN * self._target.scale))

    def estimate(self) -> np.ndarray:
        return self.mean.copy()

    def deviation(self) -> np.ndarray:
        return np.sqrt(self.var.mean(1))


class _Moving:
    """A field that goes on at its rate: for each of its numbers the mean and the covariance of both."""

    def __init__(self, target: Target, forget: float, rate: Rate) -> None:
        self._keep, self._centre, self._step = forget, target.centre, (step := 1.0 / rate.factor)
        self._onward = np.array([[1.0, step], [0.0, 1.0]])
        self._drift = rate.drift * np.array([[step**2 / 3.0, step / 2.0], [step / 2.0, 1.0]])
        rates = np.full(target.size, rate.square)
        self._unknown = np.square(UNKNOWN) * np.stack([np.square(target.scale), rates], axis=1)
        self.mean, self.cov = np.zeros((0, target.size, 2)), np.zeros((0, target.size, 2, 2))

    def begin(self, mask: np.ndarray) -> None:
        if len(self.mean) != (n := len(mask)):
            size = len(self._centre)
            self.mean, self.cov = np.zeros((n, size, 2)), np.zeros((n, size, 2, 2))
        self.mean[mask] = np.stack([self._centre, np.zeros_like(self._centre)], axis=1)
        self.cov[mask] = self._unknown[:, :, None] * np.eye(2)

    def move(self, turn: np.ndarray, before: np.ndarray, after: np.ndarray) -> None:
        self.mean = self.mean @ self._onward.T
        self.cov = self._onward @ self.cov @ self._onward.T + self._drift

    def fade(self, mask: np.ndarray) -> None:
        self.cov[mask] = self._at_most(self.cov[mask] / self._keep)

    def doubt(self, mask: np.ndarray) -> None:
        self.cov[mask] = self._at_most(self.cov[mask] / DOUBTED)

    def _at_most(self, cov: np.ndarray) -> np.ndarray:
        """Return covariances (n, D, 2, 2) no larger than those of knowing nothing."""
        too_much = np.maximum(1.0, np.max(np.diagonal(cov, axis1=2, axis2=3) / self._unknown, axis=-1))
        return cov / too_much[..., None, None]

    def tell(self, mask: np.ndarray, values: np.ndarray, spread: np.ndarray, age: np.ndarray) -> None:
        cov, noise = self.cov[mask], spread[mask]
        noise = np.diagonal(noise, axis1=1, axis2=2) if noise.ndim == 3 else noise
        then = np.stack([np.ones(len(noise)), -self._step * age[mask]], axis=1)[:, None]  # (m, 1, 2): how it was
        missed = values[mask] - (self.mean[mask] * then).sum(-1)
        shared = (cov * then[:, :, None]).sum(-1)
        var = (shared * then).sum(-1)
        far = np.square(missed) / (var + noise)
        gain = shared / (var + noise * np.maximum(1.0, far / FAR))[..., None]
        self.mean[mask] += gain * missed[..., None]
        self.cov[mask] = cov - gain[..., None] * shared[..., None, :]

    def estimate(self) -> np.ndarray:
        return self.mean[..., 0].copy()

    def deviation(self) -> np.ndarray:
        return np.sqrt(self.cov[..., 0, 0].mean(1))


class _Place:
    """A point in the world under the two hypotheses: it rests, or it moves with the tool."""

    def __init__(self, target: Target, forget: float) -> None:
        self._keep, self._centre = forget, target.centre
        self._unknown = np.diag(np.square(np.maximum(UNKNOWN * target.scale, LEAST_M)))
        self.mean, self.cov, self.chance = np.zeros((0, 2, 3)), np.zeros((0, 2, 3, 3)), np.zeros((0, 2))

    def begin(self, mask: np.ndarray) -> None:
        if len(self.mean) != (n := len(mask)):
            self.mean, self.cov, self.chance = np.zeros((n, 2, 3)), np.zeros((n, 2, 3, 3)), np.zeros((n, 2))
        self.mean[mask], self.cov[mask], self.chance[mask] = self._centre, self._unknown, (0.9, 0.1)

    def move(self, turn: np.ndarray, before: np.ndarray, after: np.ndarray) -> None:
        self.mean[:, 1] = after + np.einsum("nij,nj->ni", turn, self.mean[:, 1] - before)
        self.cov[:, 1] = turn @ self.cov[:, 1] @ np.swapaxes(turn, 1, 2)

    def fade(self, mask: np.ndarray) -> None:
        """Mix the hypotheses, as either may have become the other, and forget."""
        mean, cov, chance = self.mean[mask], self.cov[mask], self.chance[mask]
        from_to = np.array([[1.0 - SWITCH, SWITCH], [SWITCH, 1.0 - SWITCH]])
        joint = chance[:, :, None] * from_to  # of having been i and being j
        now = joint.sum(1)
        share = joint / now[:, None]
        mixed = np.einsum("nij,nik->njk", share, mean)
        apart = mean[:, :, None] - mixed[:, None]
        spread = np.einsum("nij,nijk,nijl->njkl", share, apart, apart)
        cov = np.einsum("nij,nikl->njkl", share, cov) + spread
        self.mean[mask], self.cov[mask], self.chance[mask] = mixed, self._at_most(cov / self._keep), now

    def doubt(self, mask: np.ndarray) -> None:
        """Know less, and the nearer to nothing the nearer to where it ordinarily is."""
        self.cov[mask] = self._at_most(self.cov[mask] / DOUBTED)
        self.mean[mask] = self._centre + DOUBTED * (self.mean[mask] - self._centre)

    def _at_most(self, cov: np.ndarray) -> np.ndarray:
        """Return covariances (n, 2, 3, 3) no larger than that of knowing nothing."""
        too_much = np.maximum(1.0, np.trace(cov, axis1=2, axis2=3) / np.trace(self._unknown))
        return cov / too_much[..., None, None]

    def tell(self, mask: np.ndarray, values: np.ndarray, spread: np.ndarray, carried: np.ndarray) -> None:
        mean, cov = self.mean[mask], self.cov[mask]
        missed = np.stack([values[mask], carried[mask]], axis=1) - mean
        noise = spread[mask][:, None] + np.square(LEAST_M) * np.eye(3)
        far = _squared(missed, cov + noise)
        noise = noise * np.maximum(1.0, far.min(1) / FAR)[:, None, None, None]
        total = cov + noise
        gain = cov @ np.linalg.inv(total)
        likely = np.exp(-0.5 * np.minimum(_squared(missed, total), 50.0)) / np.sqrt(np.linalg.det(total))
        chance = self.chance[mask] * likely
        self.mean[mask] = mean + np.einsum("nhij,nhj->nhi", gain, missed)
        self.cov[mask] = (np.eye(3) - gain) @ cov
        self.chance[mask] = np.clip(chance / chance.sum(1, keepdims=True), 1e-3, 1.0 - 1e-3)

    def estimate(self) -> np.ndarray:
        return np.einsum("nh,nhi->ni", self.chance, self.mean)

    def deviation(self) -> np.ndarray:
        return np.sqrt(np.einsum("nh,nhii->n", self.chance, self.cov) / 3.0)


def _squared(missed: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """Return squared lengths (...,) of vectors (..., 3) in the deviations of ``cov`` (..., 3, 3)."""
    return np.einsum("...i,...i->...", missed, np.linalg.solve(cov, missed[..., None])[..., 0])
