"""The recording benchmark lets two checkouts do the same work, and says what the difference is."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from aerial_il.benchmarks.parts.earlier.checkout import ROOT

from aerial_il.core.errors import InvalidValueError
from experiments.recording.study import EARLIER, OURS, Recording, _collecting, _files

RATES = {
    "flown": {OURS: [10.0, 20.0, 10.0], EARLIER: [10.0, 20.0, 10.0]},
    "collected": {OURS: [9.0, 18.0, 5.0], EARLIER: [3.0, 9.0, 5.0]},
    "read": {OURS: [400.0, 400.0, 400.0], EARLIER: [100.0, 200.0, 400.0]},
}


def test_shares_and_ratios_are_formed_within_a_turn() -> None:
    row = _collecting(RATES)
    assert (row["collected_per_minute"], row["share_percent"], row["share_range"]) == (540, 10.0, "10.0-50.0")
    assert (row["ratio"], row["range"]) == (2.0, "1.00-3.00")
    assert _files(RATES) == [
        {"work": "read", "ours_per_s": 400.0, "earlier_per_s": 200.0, "ratio": 2.0, "range": "1.00-4.00"}
    ]


@pytest.mark.slow
def test_end_to_end_with_itself_as_the_earlier_commit(tmp_path: Path) -> None:
    settings = Recording(
        robots=("ua_quad_arm4",), num_envs=2, demonstrations=2, converted=2, repetitions=1, threads=1, parent=str(ROOT)
    )
    report = settings.run(tmp_path, progress=False)
    assert [target.limit for target in report.targets] == [15.0, 2.0, 2.0, 4.0]
    assert [row["work"] for row in report.tables["Files"]] == ["read", "converted"]
    assert all(0.1 < row["ratio"] < 10.0 for row in report.tables["Files"]), "the same code on both sides"
    json.dumps(report.to_dict(), allow_nan=False)


def test_settings_are_checked() -> None:
    with pytest.raises(InvalidValueError, match="got 0, 1024 and 5"):
        Recording(num_envs=0)
    with pytest.raises(InvalidValueError, match="holds no aerial_il"):
        Recording(parent="/nowhere").run(Path("/nowhere"), progress=False)
