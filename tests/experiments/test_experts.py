"""The study of the experts: every cell and tier once, with targets that can be missed."""

from __future__ import annotations

from experiments.experts import study as experts
from experiments.experts.study import distinct
from tests.experiments.results import result_with


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
