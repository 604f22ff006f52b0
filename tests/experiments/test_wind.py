"""The study of the wind, in a short setting."""

import json
from pathlib import Path

from experiments.wind.study import Wind


def test_it_compares_with_theory_and_shows_each_vehicle(tmp_path: Path) -> None:
    report = Wind(robots=("ua_quad_arm4", "fa_hexa_arm4"), duration_s=400.0).run(tmp_path, progress=False)
    rows = report.tables["Wind and its drag"]
    assert [(row["robot"], row["tier"]) for row in rows][::2] == [
        ("ua_quad_arm4", "breeze"),
        ("fa_hexa_arm4", "breeze"),
    ]
    by_tier = {row["tier"]: row for row in rows if row["robot"] == "fa_hexa_arm4"}
    assert 5.0 < by_tier["breeze"]["drag_largest_percent"] < by_tier["gusts"]["drag_largest_percent"] < 30.0
    assert len(report.targets) == 6
    assert set(report.figures) == {"spectra.svg", "drag.svg"}
    json.dumps(report.to_dict(), allow_nan=False)
