"""What practice added: flights of the final policy beside those of the one it began with, seed by seed."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from experiments.from_prior.gains import gain_row, is_gain


def flights(*solved: int, count: int = 20) -> Any:
    return SimpleNamespace(episodes=[SimpleNamespace(seed=seed, success=seed in solved) for seed in range(count)])


def test_flights_are_compared_seed_by_seed_within_each_training() -> None:
    """Two trainings; on seed 1 the first wins and the second loses, which is not nothing."""
    row = gain_row([(flights(0), flights(0, 1, 2)), (flights(1, 5), flights(5))])
    assert row == {"before": 7.5, "after": 10.0, "won": 2, "lost": 1, "p": 1.0}


@pytest.mark.parametrize(("won", "lost", "gained"), [(9, 0, True), (5, 0, False), (0, 9, False), (0, 0, False)])
def test_a_gain_is_more_than_luck(won: int, lost: int, gained: bool) -> None:
    row = gain_row([(flights(*range(10, 10 + lost)), flights(*range(won)))])
    assert (row["won"], row["lost"], is_gain(row)) == (won, lost, gained)
