"""The study of recording: what its rows say, and that it runs."""

from __future__ import annotations

from experiments.recording.study import collecting_row, file_rows

RATES = {"flown": [10.0, 20.0, 10.0], "collected": [9.0, 18.0, 5.0], "read": [400.0, 100.0, 500.0]}


def test_shares_are_formed_within_a_turn() -> None:
    row = collecting_row(RATES)
    assert (row["collected_per_minute"], row["share_percent"], row["share_range"]) == (540, 10.0, "10.0-50.0")
    assert list(file_rows(RATES)) == [{"work": "read", "episodes_per_s": 400.0}]
