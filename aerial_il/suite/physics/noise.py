"""Random numbers as a pure function of (seed, time, channel): no generator state, so any step can be resumed."""

from __future__ import annotations

import math

import numpy as np

from aerial_il.core.kernels import kernel


@kernel
def mix(value):
    """SplitMix64's finaliser (Steele, Lea & Flood 2014): a bijective scrambling of 64 bits."""
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))


@kernel
def uniform(seed, tick, channel):
    """A number in (0, 1), independent over seeds, ticks and channels (non-negative integers)."""
    key = mix(np.uint64(seed) + np.uint64(0x9E3779B97F4A7C15))
    key = mix(key + np.uint64(tick) * np.uint64(0x9E3779B97F4A7C15))
    key = mix(key + np.uint64(channel) * np.uint64(0xD1B54A32D192ED03))
    return (float(key >> np.uint64(11)) + 0.5) * 2.0**-53


@kernel
def gaussian(seed, tick, channel):
    """A standard normal number (Box & Muller 1958)."""
    radius = math.sqrt(-2.0 * math.log(uniform(seed, tick, 2 * channel)))
    return radius * math.cos(2.0 * math.pi * uniform(seed, tick, 2 * channel + 1))
