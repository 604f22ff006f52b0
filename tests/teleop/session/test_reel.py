"""What is kept of an episode to be looked at again: all of a short one, never more than so much of a long one."""

from __future__ import annotations

import numpy as np
import pytest

from aerial_il.teleop.session.reel import Reel


@pytest.mark.parametrize("length", [1, 5, 10, 11, 23, 400])
def test_memory_is_bounded_and_the_states_are_evenly_spaced(length: int) -> None:
    reel = Reel(most=10)
    for k in range(length):
        reel.keep(np.array([float(k)]))
        assert len(reel) <= 10
    found = [float(state[0]) for share in np.linspace(0, 1, 21) if (state := reel.at(share)) is not None]
    assert found[0] == 0.0
    assert found == sorted(found)
    assert found[-1] > 0.8 * (length - 1) - 1
    if length <= 10:
        assert found[-1] == length - 1


def test_an_empty_one_has_nothing_to_show() -> None:
    assert Reel().at(0.5) is None
