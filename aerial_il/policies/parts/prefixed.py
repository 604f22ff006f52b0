"""Named arrays of one part among those of others: ``PART.NAME``."""

from collections.abc import Mapping

import numpy as np


def under(part: str, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the arrays of a part by names among others."""
    return {f"{part}.{name}": array for name, array in arrays.items()}


def below(part: str, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the arrays of a part by names of its own, as they were before :func:`under`."""
    return {name.removeprefix(f"{part}."): array for name, array in arrays.items() if name.startswith(f"{part}.")}
