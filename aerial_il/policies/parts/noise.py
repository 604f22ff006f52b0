"""Random numbers for a policy that flies n worlds: decided by what each world saw first, never by its neighbours.

A generator that the worlds share would make an action depend on how many of them there are, and one keyed by the
present observation would turn a rounding error into another action. Here the bits of an episode's first observation,
or its pixels where a policy sees nothing else, are the key, and a counter gives the numbers: the same episode gets the
same ones wherever and whenever it is flown.

Source: G. Steele, D. Lea, C. Flood, "Fast Splittable Pseudorandom Number Generators", 2014 (SplitMix64);
G. Box, M. Muller, "A Note on the Generation of Random Normal Deviates", 1958.
"""

from collections.abc import Mapping, Sequence

import numpy as np

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
MIXERS = ((30, np.uint64(0xBF58476D1CE4E5B9)), (27, np.uint64(0x94D049BB133111EB)))


class EpisodeNoise:
    """Standard normal numbers of each world.

    Args:
        size: how many numbers S one prediction takes; 0 for a policy without chance.
        redraw: whether each prediction gets new ones; else an episode keeps its own, so that overlapping chunks agree
            on what to do where there are several ways.
    """

    def __init__(self, size: int, *, redraw: bool = False) -> None:
        self.size, self.redraw = size, redraw
        self._key = np.zeros(0, np.uint64)
        self._count = np.zeros(0, np.uint64)  # predictions made in this episode
        self._fresh = np.zeros(0, bool)
        self._numbers = np.zeros((0, size), np.float32)

    def take(self, frames: np.ndarray, due: np.ndarray) -> np.ndarray:
        """Return numbers (m, S) for the m worlds in ``due`` (n,) bool, which see ``frames`` (n, Do)."""
        if len(self._key) != len(frames):
            self._key, self._count = np.zeros((2, len(frames)), np.uint64)
            self._fresh, self._numbers = np.ones(len(frames), bool), np.zeros((len(frames), self.size), np.float32)
        if self._fresh.any():
            self._key[self._fresh], self._count[self._fresh] = fingerprints(frames[self._fresh]), 0
        drawn = self._fresh | (due if self.redraw else False)
        if drawn.any():
            self._numbers[drawn] = normal_numbers(_mixed(self._key[drawn] + self._count[drawn]), self.size)
            self._count[drawn] += np.uint64(1)
            self._fresh[:] = False
        return self._numbers[due]

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Forget the worlds in ``mask`` (n,), or all of them and their number."""
        if mask is None:
            self._key = self._key[:0]
        elif len(self._key):
            self._fresh |= mask

    def memory(self) -> dict[str, np.ndarray]:
        """Return copies of all that the next numbers depend on."""
        arrays = {"key": self._key, "count": self._count, "fresh": self._fresh, "numbers": self._numbers}
        return {name: array.copy() for name, array in arrays.items()}

    def recall(self, memory: Mapping[str, np.ndarray]) -> None:
        """Go on from what :meth:`memory` returned."""
        self._key, self._count = memory["key"].copy(), memory["count"].copy()
        self._fresh, self._numbers = memory["fresh"].copy(), memory["numbers"].copy()


def fingerprints(frames: np.ndarray) -> np.ndarray:
    """Return one key (n,) uint64 for the bits of each row of ``frames`` (n, Do)."""
    bits = np.ascontiguousarray(frames.T + 0.0, dtype=np.float64).view(np.uint64)  # + 0.0: there is only one zero
    keys = np.zeros(len(frames), np.uint64)
    for column in bits:
        keys = _mixed((keys ^ column) + GOLDEN)
    return keys


def glimpses(images: Sequence[np.ndarray]) -> np.ndarray:
    """Return a number (n, C) for each of C cameras' ``images`` (n, H, W, ...), exact, of every pixel."""
    sums = []
    for image in images:
        whole = image if image.dtype == np.uint8 else np.ascontiguousarray(image, np.float32).view(np.uint32)
        pixels = whole.reshape(len(image), -1).astype(np.uint64)
        places = _mixed(np.arange(1, pixels.shape[1] + 1, dtype=np.uint64) * GOLDEN)
        sums.append(((pixels * places).sum(axis=1) >> np.uint64(11)).astype(np.float64))
    return np.stack(sums, axis=1)


def normal_numbers(keys: np.ndarray, size: int) -> np.ndarray:
    """Return independent standard normal numbers (n, size), float32, for each key (n,) uint64."""
    pairs = (size + 1) // 2
    bits = _mixed(keys[:, None] + np.arange(1, 2 * pairs + 1, dtype=np.uint64) * GOLDEN)
    uniform = ((bits >> np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53
    radius, angle = np.sqrt(-2.0 * np.log(uniform[:, :pairs])), 2.0 * np.pi * uniform[:, pairs:]
    return np.concatenate([radius * np.cos(angle), radius * np.sin(angle)], 1)[:, :size].astype(np.float32)


def _mixed(z: np.ndarray) -> np.ndarray:
    for shift, factor in MIXERS:
        z = (z ^ (z >> np.uint64(shift))) * factor
    return z ^ (z >> np.uint64(31))
