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
from typing import NamedTuple

import numpy as np

from aerial_il.policies.perception.relations import Rate
from aerial_il.policies.perception.targets import PLACE, Target

SWITCH = 0.02  # chance, from one frame to the next, that what rested moves with the tool, or the other way round
FAR = 9.0  # squared distance, in deviations, beyond which a measurement weighs less
LEAST_M = 1e-3  # deviation that a place is never known better than
DOUBTED = 0.8  # share of what is known that is kept where a place should be in an image, and is not
UNKNOWN = 2.0  # deviations of the demonstrations, by which nothing is known


class Measurement(NamedTuple):
    """What a camera tells of a field in n worlds.

    Attributes:
        values: (n, D), as they were when the image was taken.
        spread: (n, 3, 3) covariances of a place, (n, D) variances of others.
        age: (n,) control steps since then; None for none.
        carried: (n, 3) where a place is now if the tool has carried it since; None for where it was.
    """

    values: np.ndarray
    spread: np.ndarray
    age: np.ndarray | None = None
    carried: np.ndarray | None = None


class Tracker:
    """Estimates of all targets.

    Args:
        targets: what is followed. forget: share of what is known that is kept from one frame to the next.
        rates: of some of them that are wanted, too.
    """

    def __init__(self, targets: Sequence[Target], forget: float, rates: Sequence[Rate] = ()) -> None:
        self.targets, wanted = tuple(targets), {rate.of: rate for rate in rates}
        self._filters: dict[str, _Place | _Numbers] = {
            each.field: (_Place if each.kind == PLACE else _Numbers)(each, forget) for each in targets
        }
        moving = {each.field: _Numbers(each, forget, wanted[each.field]) for each in targets if each.field in wanted}
        self._filters |= moving
        self._rates = {wanted[name].field: each for name, each in moving.items()}

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

    def tell(self, field: str, mask: np.ndarray, told: Measurement) -> None:
        """Take in what a camera tells of a field in the worlds of ``mask`` (n,) bool."""
        self._filters[field].tell(mask, told)

    def doubt(self, field: str, mask: np.ndarray) -> None:
        """Know less of a place in the worlds of ``mask`` (n,) bool: where it should be in an image, it is not."""
        self._filters[field].doubt(mask)

    def estimate(self, field: str) -> np.ndarray:
        """Return one estimate (n, D) as it is."""
        return self._filters[field].estimate()

    def estimates(self) -> dict[str, np.ndarray]:
        """Return ``field -> (n, D)``."""
        told = {each.field: each.straightened(self._filters[each.field].estimate()) for each in self.targets}
        return told | {name: each.rate() for name, each in self._rates.items()}

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
    """A field that is told number by number: the mean of each and its variance, or those of it and its rate."""

    def __init__(self, target: Target, forget: float, rate: Rate | None = None) -> None:
        self._keep, self._centre, self._step = forget, target.centre, 1.0 / rate.factor if rate else 0.0
        unknown, self._onward, self._drift = [np.square(target.scale)], np.eye(1), target.drift[:, None, None]
        if rate is not None:
            step = self._step
            unknown.append(np.full(target.size, rate.square))
            self._onward = np.array([[1.0, step], [0.0, 1.0]])
            self._drift = rate.drift * np.array([[step**2 / 3.0, step / 2.0], [step / 2.0, 1.0]])
        self._unknown = np.square(UNKNOWN) * np.stack(unknown, axis=1)  # (D, 1 or 2) variances
        self.mean, self.cov = self._blank(0)

    def _blank(self, n: int) -> tuple[np.ndarray, np.ndarray]:
        size, order = self._unknown.shape
        return np.zeros((n, size, order)), np.zeros((n, size, order, order))

    def begin(self, mask: np.ndarray) -> None:
        if len(self.mean) != len(mask):
            self.mean, self.cov = self._blank(len(mask))
        self.mean[mask], self.cov[mask] = 0.0, self._unknown[:, :, None] * np.eye(self._unknown.shape[1])
        self.mean[mask, :, 0] = self._centre

    def move(self, turn: np.ndarray, before: np.ndarray, after: np.ndarray) -> None:
        self.mean = self.mean @ self._onward.T
        self.cov = self._onward @ self.cov @ self._onward.T + self._drift

    def fade(self, mask: np.ndarray) -> None:
        self.cov[mask] = self._at_most(self.cov[mask] / self._keep)

    def doubt(self, mask: np.ndarray) -> None:
        self.cov[mask] = self._at_most(self.cov[mask] / DOUBTED)

    def _at_most(self, cov: np.ndarray) -> np.ndarray:
        """Return covariances no larger than those of knowing nothing."""
        too_much = np.maximum(1.0, np.max(np.diagonal(cov, axis1=2, axis2=3) / self._unknown, axis=-1))
        return cov / too_much[..., None, None]

    def tell(self, mask: np.ndarray, told: Measurement) -> None:
        cov, noise = self.cov[mask], told.spread[mask]
        noise = np.diagonal(noise, axis1=1, axis2=2) if noise.ndim == 3 else noise
        age = np.zeros(len(noise)) if told.age is None else told.age[mask]
        then = np.stack([np.ones(len(noise)), -self._step * age], axis=1)[:, None, : cov.shape[-1]]  # how it was
        missed = told.values[mask] - (self.mean[mask] * then).sum(-1)
        shared = (cov * then[:, :, None]).sum(-1)
        var = (shared * then).sum(-1)
        far = np.square(missed) / (var + noise)
        gain = shared / (var + noise * np.maximum(1.0, far / FAR))[..., None]
        self.mean[mask] += gain * missed[..., None]
        cov = cov - gain[..., None] * shared[..., None, :]
        self.cov[mask] = 0.5 * (cov + np.swapaxes(cov, 2, 3))  # what forgetting makes of a rounding error grows

    def estimate(self) -> np.ndarray:
        return self.mean[..., 0].copy()

    def rate(self) -> np.ndarray:
        return self.mean[..., 1].copy()

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

    def tell(self, mask: np.ndarray, told: Measurement) -> None:
        mean, cov = self.mean[mask], self.cov[mask]
        carried = told.values if told.carried is None else told.carried
        missed = np.stack([told.values[mask], carried[mask]], axis=1) - mean
        noise = told.spread[mask][:, None] + np.square(LEAST_M) * np.eye(3)
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
        """Return (n,) m, of an axis: how unsure each hypothesis is, and how far they are apart."""
        apart = self.mean - self.estimate()[:, None]
        within, between = np.einsum("nhii->nh", self.cov), np.einsum("nhi,nhi->nh", apart, apart)
        return np.sqrt(np.einsum("nh,nh->n", self.chance, within + between) / 3.0)


def _squared(missed: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """Return squared lengths (...,) of vectors (..., 3) in the deviations of ``cov`` (..., 3, 3)."""
    return np.einsum("...i,...i->...", missed, np.linalg.solve(cov, missed[..., None])[..., 0])
