"""Build a network whose settings came out of a file, no larger than the weights that came with them."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import numpy as np
import torch
from torch import nn
from torch.nn.modules import module

from aerial_il.core.errors import InvalidValueError

PARTS_PER_ARRAY, MORE_PARTS = 20, 1000  # modules: many, such as activations, have no weights


def built_for[Built](arrays: Mapping[str, np.ndarray], build: Callable[[], Built]) -> Built:
    """Return what ``build`` makes, tried first without memory: settings may ask for any number of layers and units.

    Args:
        arrays: the weights that were saved. build: makes the network.

    Raises:
        InvalidValueError: it would have more weights than were saved.
    """
    with torch.device("meta"), _counted(sum(array.size for array in arrays.values()), len(arrays)):
        build()
    return build()


@contextmanager
def _counted(elements: int, arrays: int) -> Iterator[None]:
    """End the building of a network that takes more parameters or parts than there are weights for."""
    parts = PARTS_PER_ARRAY * arrays + MORE_PARTS
    left = {"weights": elements, "arrays of weights": arrays, "parts": parts}
    limits = dict(left)

    def take(what: str, count: int) -> None:
        left[what] -= count
        if left[what] < 0:
            raise InvalidValueError(f"its settings ask for more than the {limits[what]} {what} that were saved with it")

    def parameter(owner: nn.Module, name: str, value: nn.Parameter | None) -> None:
        if value is not None:
            take("weights", value.numel())
            take("arrays of weights", 1)

    def part(owner: nn.Module, name: str, value: nn.Module | None) -> None:
        take("parts", 1)

    hooks = (
        module.register_module_parameter_registration_hook(parameter),
        module.register_module_module_registration_hook(part),
    )
    try:
        yield
    finally:
        for hook in hooks:
            hook.remove()
