"""Which action elements demonstrations never varied, as a saved policy tells.

A normaliser leaves them in their own units, with a scale of 1, and mostly that tells them from the others. But commands
that fill [-1, 1] have half a range of 1 too. Where the scale would be misread, the policy says which are constant.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from aerial_il.policies.parts.layout import Interface, Layout
from aerial_il.policies.parts.normaliser import Normaliser, Scaling

ARRAY = "action.constant"


def saved(interface: Interface, scaling: Scaling) -> dict[str, np.ndarray]:
    """Return by name what is saved beside centre and scale: nothing where these tell as much."""
    presumed = presumably(interface.action, interface.layout, scaling)
    return {} if (interface.constant == presumed).all() else {ARRAY: interface.constant}


def restored(arrays: Mapping[str, np.ndarray], action: Normaliser, layout: Layout, scaling: Scaling) -> Normaliser:
    """Return ``action`` with what was :func:`saved` beside its centre and scale."""
    presumed = presumably(action, layout, scaling)
    return replace(action, constant=arrays.get(ARRAY, presumed))


def presumably(action: Normaliser, layout: Layout, scaling: Scaling) -> np.ndarray:
    """Return (Da,) bool, what centre and scale tell; where that is right, nothing else is saved.

    An interval that is exactly the environment's, from -1 to 1 or from 0 to 2, is taken to have been filled: by
    ``minmax``, or by reinforcement learning, whose actions lie in the bounds.
    """
    low, high = np.asarray(layout.spec.action.low, float), np.asarray(layout.spec.action.high, float)
    with np.errstate(invalid="ignore"):  # without bounds there is no middle
        middle, half = (0.5 * (low + high)).astype(np.float32), (0.5 * (high - low)).astype(np.float32)
    filled = (action.centre == middle) & (action.scale == half) & ~layout.moving & (scaling == "minmax")
    return (action.scale == 1.0) & ~filled
