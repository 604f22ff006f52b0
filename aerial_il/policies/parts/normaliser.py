"""Affine scaling of observations and actions, fitted once on the demonstrations and saved with the policy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from aerial_il.core.errors import InvalidValueError

Scaling = Literal["standard", "minmax"]
MIN_SCALE = 1e-3  # smaller spreads, in the data's own units, are noise around a constant: dividing by them amplifies it


@dataclass(frozen=True, eq=False)
class Normaliser:
    """The map ``z = (x - centre) / scale``, element by element.

    Attributes:
        centre: (D,) float32.
        scale: (D,) float32, positive.
        constant: (D,) bool, elements that hardly varied and have kept their own units; None where all varied.
    """

    centre: np.ndarray
    scale: np.ndarray
    constant: np.ndarray | None = None

    def __post_init__(self) -> None:
        if self.centre.shape != self.scale.shape or self.centre.ndim != 1:
            raise InvalidValueError(f"centre {self.centre.shape} and scale {self.scale.shape} must both be (D,).")
        if self.constant is not None and (self.constant.shape, self.constant.dtype) != (self.scale.shape, bool):
            found, wanted = f"{self.constant.dtype} {self.constant.shape}", self.scale.shape
            raise InvalidValueError(f"constant is {found}; it must be bool {wanted}, one for each scale.")
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
    def fit(data: np.ndarray, scaling: Scaling = "standard") -> Normaliser:
        """Fit to ``data`` (N, D).

        Args:
            data: samples in SI units.
            scaling: ``standard`` gives mean 0 and deviation 1, ``minmax`` the interval [-1, 1].

        Returns:
            The normaliser; elements that hardly vary are centred and otherwise left in their own units.
        """
        if data.ndim != 2 or len(data) == 0:
            raise InvalidValueError(f"Normalisation needs samples (N, D) with N > 0, got shape {data.shape}.")
        if scaling not in get_args(Scaling):
            raise InvalidValueError(f"Unknown scaling {scaling!r}. Valid: {', '.join(get_args(Scaling))}.")
        data = data.astype(np.float64)
        if scaling == "standard":
            centre, scale = data.mean(0), data.std(0)
        else:
            low, high = data.min(0), data.max(0)
            centre, scale = (high + low) / 2, (high - low) / 2
        constant = scale < MIN_SCALE
        scale = np.where(constant, 1.0, scale)
        return Normaliser(centre.astype(np.float32), scale.astype(np.float32), constant)

    def normalise(self, x: np.ndarray) -> np.ndarray:
        """Scale ``x`` (..., D) to float32."""
        return ((x - self.centre) / self.scale).astype(np.float32, copy=False)

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
