"""The study of recording: what its rows say, and that it runs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from aerial_il.core.errors import InvalidValueError
from experiments.recording.study import Recording, collecting_row, file_rows

RATES = {"flown": [10.0, 20.0, 10.0], "collected": [9.0, 18.0, 5.0], "read": [400.0, 100.0, 500.0]}


def test_shares_are_formed_within_a_turn() -> None:
    row = collecting_row(RATES)
    assert (row["collected_per_minute"], row["share_percent"], row["share_range"]) == (540, 10.0, "10.0-50.0")
    assert list(file_rows(RATES)) == [{"work": "read", "episodes_per_s": 400.0}]


@pytest.mark.slow
def test_end_to_end(tmp_path: Path) -> None:
    settings = Recording(robots=("ua_quad_arm4",), num_envs=2, demonstrations=2, converted=2, repetitions=1, threads=1)
    report = settings.run(tmp_path, progress=False)
    assert [target.limit for target in report.targets] == [15.0]
    assert [row["work"] for row in report.tables["Files"]] == ["read", "converted"]
    assert all(row["episodes_per_s"] > 0.0 for row in report.tables["Files"])
    json.dumps(report.to_dict(), allow_nan=False)


def test_settings_are_checked() -> None:
    with pytest.raises(InvalidValueError, match="got 0, 1024 and 5"):
        Recording(num_envs=0)
