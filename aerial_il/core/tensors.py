"""From numpy to torch so that equal numbers give equal results, bit for bit."""

import numpy as np
import torch
from torch import Tensor


def tensor(array: np.ndarray) -> Tensor:
    """Return a copy of ``array`` in torch's own memory.

    Numpy's memory begins at any multiple of 16 bytes, torch's at one of 64, and the last bit of a matrix product may
    depend on it: a network fed with numpy's memory does not repeat itself from one process to the next.

    Source: Intel, "Developer Guide for oneMKL", section "Obtaining Numerically Reproducible Results".
    """
    return torch.from_numpy(np.ascontiguousarray(array)).clone()
