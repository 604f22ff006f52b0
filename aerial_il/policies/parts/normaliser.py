"""Affine scaling of observations and actions, fitted once on the demonstrations and saved with the policy."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from aerial_il.core.errors import InvalidValueError

Scaling = Literal["standard", "minmax"]
HARDLY = 1e-3  # of its size: what varies by no more is noise around a constant, and dividing by that would amplify it
BLOCK = 1 << 16  # rows at once
ROUNDING = 1e-14  # of the largest size: what varies by no more is an error of rounding


def hardly_varies(spread: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Return which elements are as good as constant (D,) bool, by their spread and size (D,) in whatever unit."""
    return spread <= np.maximum(HARDLY * size, ROUNDING * size.max(initial=0.0))


class Samples:
    """Samples (N, D) that need not fit into memory: ``blocks`` returns them anew, some at a time."""

    def __init__(self, blocks: Callable[[], Iterable[np.ndarray]]) -> None:
        self._blocks = blocks

    def __iter__(self) -> Iterator[np.ndarray]:
        return iter(self._blocks())

    @staticmethod
    def of(data: np.ndarray) -> Samples:
        """Return the samples of an array."""
        return Samples(lambda: (data[start : start + BLOCK] for start in range(0, len(data), BLOCK)))


def _moments(samples: Samples, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and standard deviation (D,)."""
    first = next(iter(samples))
    if first.shape[1] == 1:  # summed up by NumPy in another order
        data = np.concatenate([*samples])
        return data.mean(0, dtype=np.float64), data.std(0, dtype=np.float64)
    mean = _sum(samples, lambda block: block.astype(np.float64)) / count
    return mean, np.sqrt(_sum(samples, lambda block: (block - mean) ** 2) / count)


def _sum(samples: Samples, of: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Return the sum (D,) over all rows one after the other, as of one array: the last bit depends on the order."""
    total: np.ndarray | None = None
    for block in samples:
        total = np.add.reduce(of(block) if total is None else np.concatenate([total[None], of(block)]))
    assert total is not None
    return total


@dataclass(frozen=True, eq=False)
class Normaliser:
    """The map ``z = (x - centre) / scale``, element by element.

    Attributes:
        centre: (D,) float32.
        scale: (D,) float32, positive.
        constant: (D,) bool, elements that hardly varied; None where all varied.
    """

    centre: np.ndarray
    scale: np.ndarray
    constant: np.ndarray | None = None

    def __post_init__(self) -> None:
        if self.centre.shape != self.scale.shape or self.centre.ndim != 1:
            raise InvalidValueError(f"centre {self.centre.shape} and scale {self.scale.shape} must both be (D,).")
        if self.constant is not None and (self.constant.shape, self.constant.dtype) != (self.scale.shape, bool):
            given, wanted = f"{self.constant.dtype} {self.constant.shape}", self.scale.shape
            raise InvalidValueError(f"constant is {given}; it must be bool {wanted}, one for each scale.")
        if not (np.isfinite(self.centre).all() and np.isfinite(self.scale).all() and (self.scale > 0).all()):
            raise InvalidValueError("A normaliser's centre must be finite, its scale finite and positive.")

    @staticmethod
    def none(size: int) -> Normaliser:
        """Leave ``size`` elements as they are."""
        return Normaliser(np.zeros(size, np.float32), np.ones(size, np.float32))

    @property
    def is_identity(self) -> bool:
        """Whether everything stays as it is."""
        return bool((self.centre == 0).all() and (self.scale == 1).all())

    @staticmethod
    def fit(
        data: np.ndarray | Samples, scaling: Scaling = "standard", *, reach: np.ndarray | None = None
    ) -> Normaliser:
        """Fit to ``data`` (N, D), whatever unit each element has.

        Args:
            data: samples.
            scaling: ``standard`` gives mean 0 and deviation 1, ``minmax`` the interval [-1, 1].
            reach: (D,) how far elements could vary, where that is bounded; infinite where it is not.

        Returns:
            The normaliser; elements that hardly vary are centred and otherwise left in their own units if they are
            small, and divided by their size if that is above 1.
        """
        if isinstance(data, np.ndarray):
            if data.ndim != 2 or len(data) == 0:
                raise InvalidValueError(f"Normalisation needs samples (N, D) with N > 0, got shape {data.shape}.")
            data = Samples.of(data)
        if scaling not in get_args(Scaling):
            raise InvalidValueError(f"Unknown scaling {scaling!r}. Valid: {', '.join(get_args(Scaling))}.")
        lows, highs, counts = zip(*((block.min(0), block.max(0), len(block)) for block in data), strict=True)
        low, high, count = np.min(lows, 0).astype(np.float64), np.max(highs, 0).astype(np.float64), sum(counts)
        centre, scale = _moments(data, count) if scaling == "standard" else ((high + low) / 2, (high - low) / 2)
        size = np.maximum(np.abs(low), np.abs(high))
        constant = hardly_varies(
            scale, size if reach is None else np.where(np.isfinite(reach), np.maximum(size, reach), size)
        )
        scale = np.where(constant, np.maximum(size, 1.0), scale)
        return Normaliser(centre.astype(np.float32), scale.astype(np.float32), constant)

    def normalise(self, x: np.ndarray) -> np.ndarray:
        """Scale ``x`` (..., D) to float32."""
        return ((x - self.centre) / self.scale).astype(np.float32, copy=False)

    def first(self, size: int) -> Normaliser:
        """Return the map of the first ``size`` elements alone."""
        return Normaliser(self.centre[:size], self.scale[:size])

    def tiled(self, times: int) -> Normaliser:
        """Return the map of so many samples side by side, (times * D,): NumPy is fast along long rows only."""
        return Normaliser(np.tile(self.centre, times), np.tile(self.scale, times))

    def denormalise(self, z: np.ndarray) -> np.ndarray:
        """Return values in the data's units for ``z`` (..., D)."""
        return z * self.scale + self.centre

    def arrays(self, prefix: str) -> dict[str, np.ndarray]:
        """Return both arrays under ``prefix.centre`` and ``prefix.scale``."""
        return {f"{prefix}.centre": self.centre, f"{prefix}.scale": self.scale}

    @staticmethod
    def from_arrays(arrays: Mapping[str, np.ndarray], prefix: str) -> Normaliser:
        """Rebuild from :meth:`arrays`.

        Raises:
            InvalidValueError: the statistics are missing.
        """
        for name in (f"{prefix}.centre", f"{prefix}.scale"):
            if name not in arrays:
                raise InvalidValueError(f"the normalisation statistics {name} are missing; train the policy again")
        return Normaliser(arrays[f"{prefix}.centre"], arrays[f"{prefix}.scale"])
