"""What torch computes does not depend on where numpy happened to put its numbers."""

from __future__ import annotations

import numpy as np
import pytest

from aerial_il.core.tensors import tensor


@pytest.mark.parametrize("offset", [0, 4, 16, 52])
def test_a_tensor_begins_at_a_cache_line(offset: int) -> None:
    memory = np.zeros(400, np.uint8)
    start = -memory.ctypes.data % 64 + offset
    array = memory[start : start + 240].view(np.float32).reshape(15, 4)
    copied = tensor(array)
    array += 1.0
    assert copied.data_ptr() % 64 == 0
    assert (copied == 0.0).all()
