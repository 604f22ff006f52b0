"""Judging bears few episodes, flights that stand still, and copies of copies."""

import numpy as np
import pytest

from aerial_il.data.quality.consistency import consistency
from aerial_il.data.quality.duplicates import repeated
from aerial_il.data.quality.information import information
from aerial_il.data.quality.trace import Trace, normalised


def traces(count: int, seed: int = 0) -> list[Trace]:
    rng = np.random.default_rng(seed)
    shapes = ((60, 5), (60, 3))
    return [Trace(f"e{i}", *(rng.normal(size=shape).astype("f") for shape in shapes), 0.05) for i in range(count)]


@pytest.mark.parametrize("seed", range(12))
def test_as_few_episodes_as_are_judged_are_whichever_are_trusted(seed: int) -> None:
    found = consistency(normalised(traces(8, seed)))
    assert len(found) == 8
    assert np.isfinite([each.missed for each in found.values()]).all()


def test_a_flight_that_stands_still_informs_finitely() -> None:
    first, *others = traces(8)
    first.states[20:], first.actions[20:] = first.states[20], first.actions[20]
    assert np.isfinite([*information(normalised([first, *others])).values()]).all()


def test_all_copies_of_an_episode_repeat_the_first() -> None:
    own = traces(26)
    copies = [Trace(f"c{i}", own[3].states.copy(), own[3].actions.copy(), 0.05) for i in range(3)]
    assert repeated(normalised([*own[:10], *copies, *own[10:]])) == {"c0": "e3", "c1": "e3", "c2": "e3"}
