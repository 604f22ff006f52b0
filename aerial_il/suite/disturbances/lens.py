"""Lens: exposure, white balance, blur and noise of cameras, which images are rendered without."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from aerial_il.robots.robot import Robot
from aerial_il.suite.disturbances.disturbance import Disturbance, Strength
from aerial_il.suite.disturbances.nominal import LENS, Nominal

GAINS, BLUR, NOISE = slice(0, 3), 3, 4  # columns of LENS


@dataclass(frozen=True)
class Lens(Disturbance):
    """Colour images of the robot's cameras, each with draws of its own for an episode; noise is new in every image.

    Attributes:
        exposure: images are darker by up to e to this power, or brighter by a third of that, as scenes are bright.
        white: by up to e to this power each colour alone is brighter or darker.
        blur: standard deviation of the largest blur, as a share of the image's height. noise: largest standard
            deviation of a pixel's noise, of 255.
    """

    exposure: float = 0.25
    white: float = 0.05
    blur: float = 0.01
    noise: float = 5.0
    strength: ClassVar[Strength | None] = Strength("times the exposure, white balance, blur and noise", 0.0, 3.0)
    varies: ClassVar[tuple[str, ...]] = (LENS,)

    @classmethod
    def of(cls, strength: float) -> Lens:
        return cls(*(strength * value for value in (cls.exposure, cls.white, cls.blur, cls.noise)))

    def unfelt(self, robot: Robot) -> str | None:
        return None if robot.mounted_cameras else f"{robot.name} has no cameras"

    def vary(self, fields: dict[str, np.ndarray], nominal: Nominal, rng: np.random.Generator) -> dict[str, Any]:
        lens = fields[LENS]
        exposure = rng.uniform(-self.exposure, self.exposure / 3.0, (len(lens), 1))
        lens[:, GAINS] *= np.exp(exposure + rng.uniform(-self.white, self.white, (len(lens), 3)))
        lens[:, BLUR] += rng.uniform(0.0, self.blur, len(lens))
        lens[:, NOISE] += rng.uniform(0.0, self.noise, len(lens))
        return {"camera_gains": lens[:, GAINS].tolist()}


def through_lens(image: np.ndarray, lens: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return a colour image (H, W, 3) uint8 as a camera takes it.

    Args:
        lens: a row of ``LENS``. rng: of this image's noise.
    """
    taken = blurred(image.astype(np.float32), float(lens[BLUR]) * len(image))
    taken.reshape(len(image), -1)[:] *= np.tile(lens[GAINS].astype(np.float32), image.shape[1])
    taken += np.float32(lens[NOISE]) * rng.standard_normal(image.shape, np.float32)
    return np.rint(np.clip(taken, 0.0, 255.0, out=taken), out=taken).astype(np.uint8)


def blurred(image: np.ndarray, sigma: float) -> np.ndarray:
    """Return ``image`` (H, W, C) convolved with a Gaussian of ``sigma`` pixels; its border goes on beyond it."""
    reach = int(np.ceil(2.0 * sigma))
    if not reach or sigma < 0.1:
        return image
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    weights = (weights / weights.sum()).astype(np.float32)
    for axis in (0, 1):
        rows, spread = np.arange(image.shape[axis]), np.zeros_like(image)
        for weight, k in zip(weights, range(-reach, reach + 1), strict=True):
            spread += weight * image.take(np.clip(rows + k, 0, rows[-1]), axis)
        image = spread
    return image


TIERS: dict[str, Lens] = {}
