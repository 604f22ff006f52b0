"""The study of the experts: every cell and tier once, with targets that can be missed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

import aerial_il
from aerial_il.evaluation.result import load_result
from experiments.experts import study as experts
from experiments.experts.study import Experts, distinct
from tests.experiments.results import result_with

SMALL = Experts(tasks=("reach",), tiers=("calm",), episodes=1, returns=2, threads=1)


@pytest.mark.slow
def test_experts_fly_every_cell_and_resume(tmp_path: Path) -> None:
    report = replace(SMALL, robots=("ua_quad_arm4",)).run(tmp_path, progress=False)
    (row,) = report.tables["Success of the experts"]
    assert (row["robot"], row["task"], row["tier"], row["success"]) == ("ua_quad_arm4", "reach", "calm", 1)
    (kept,) = tmp_path.glob("evaluations/ua_quad_arm4-reach/calm-*/evaluation.json")
    assert load_result(kept).seeds == [10_000]
    (earned,) = report.tables["Returns"]
    assert earned["sparse_is_success"]
    assert [target.limit for target in report.targets] == [99.0], "what an expert earns beside no plan is no target"
    json.dumps(report.to_dict(), allow_nan=False)

    before = kept.stat().st_mtime_ns
    again = SMALL.run(tmp_path, progress=False)
    reaching = [cell for cell in aerial_il.list_cells() if cell[1] == "reach"]
    assert [(row["robot"], row["task"]) for row in again.tables["Success of the experts"]] == reaching
    assert kept.stat().st_mtime_ns == before
    replace(SMALL, robots=("ua_quad_arm4",), episodes=2).run(tmp_path, progress=False)
    assert len(list(kept.parents[1].glob("*/evaluation.json"))) == 2, "two flights are not the one that was kept"


def test_tiers_in_which_the_flights_are_the_same_count_once() -> None:
    calm, hard = result_with(4, 4), result_with(4, 2)
    assert distinct({"calm": calm, "breeze": calm, "hard": hard}) == {"calm": ["breeze"], "hard": []}


def test_every_target_can_be_missed() -> None:
    cells = [("big_four_z1", "inspect_contact"), ("ua_quad_arm4", "insert_peg"), ("ua_quad_arm4", "reach")]
    none = {"percent": 0.0, "ci95_low": 0.0, "ci95_high": 2.0, "success": 0, "episodes": 200}
    rows = [{"robot": r, "task": t, "tier": tier, **none} for r, t in cells for tier in ("calm", "gusts", "hard")]
    targets = list(experts.targets_of(rows))
    assert [t.limit for t in targets] == [99.0, 95.0, 85.0, 99.0, 95.0, 95.0, 99.0, 95.0]
    assert not any(target.met for target in targets)
