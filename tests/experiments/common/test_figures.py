"""What figures show can be told from one another, and read off."""

from __future__ import annotations

import re
from typing import Any

import pytest

from experiments.common.figures import mismatch_lines, success_curves
from experiments.from_prior.lines import STEP_TICKS, kept_apart, looks_of, practice_lines

ARMS = ("expert_iteration", "filtered_bc", "bc_ppo", "residual", "dapg", "jsrl", "ibrl", "rlpd", "ppo")
CLONES = ("bc, first", "bc, as practice begins", "bc, many")
CELL: tuple[str, int] = ("pick_place", 10)


def final(arm: str, flown: int = 1000) -> dict[str, Any]:
    """A final policy that solves 90 %."""
    ends = {"percent": 90.0, "flights_low": 85.0, "flights_high": 93.0}
    return {"arm": arm, "task": CELL[0], "demos": CELL[1], "flown": flown, **ends}


def way(arm: str, draw: int, *percent: float, faint: bool = False) -> list[dict[str, Any]]:
    head = {"arm": arm, "task": CELL[0], "demos": CELL[1], "draw": draw, "faint": faint}
    return [{**head, "percent": p, "flown": 1000 * k, "minutes": 1.0 * k} for k, p in enumerate(percent)]


def texts(svg: str) -> set[str]:
    return set(re.findall(r">([^<>\n]+)</text>", svg))


def test_no_two_arms_look_alike() -> None:
    looks = looks_of([*(final(arm) for arm in ARMS), *(final(arm, flown=0) for arm in CLONES)])
    assert len({(look.colour, look.marker) for look in looks.values()}) == len({look.colour for look in looks.values()})
    assert len({look.marker for look in looks.values()}) == len(ARMS) + len(CLONES)


@pytest.mark.parametrize(
    ("over", "axis"), [("flown", "control steps flown"), ("minutes", "minutes of flying and learning")]
)
def test_practice_is_drawn_with_tier_target_and_arms(over: str, axis: str) -> None:
    rows = [*way("bc_ppo", 0, 50.0, 80.0), *way("bc_ppo", 1, 55.0, 70.0), *way("ppo", 0, 0.0, 10.0, faint=True)]
    policies = [final("bc, first", flown=0), final("bc_ppo"), final("ppo")]
    titles, wanted = {CELL: "pick_place from 10, in gusts"}, {CELL: 85.0, ("insert_peg", 40): 90.0}
    svg = practice_lines(rows, policies, over=over, titles=titles, wanted=wanted)
    assert {"bc, first", "bc_ppo", "ppo", "wanted", "final", axis, titles[CELL]} <= texts(svg)
    assert practice_lines(rows, policies, over=over, titles=titles, wanted=wanted) == svg, "the same bytes"
    assert "wanted" not in texts(practice_lines(rows, policies, over=over, titles=titles, wanted={}))


def test_ticks_whose_labels_would_touch_are_left_out() -> None:
    assert kept_apart(list(STEP_TICKS), 8e6) == [0.0, 1e5, 5e5, 1e6, 2e6, 4e6, 8e6, 2e7]
    assert kept_apart(list(STEP_TICKS), 2e7) == [0.0, 5e5, 2e6, 4e6, 8e6, 2e7]


def test_learning_is_drawn_from_no_step_on_in_millions() -> None:
    shown = texts(success_curves({("hover", "ppo"): [[(1e6, 10.0), (4e6, 90.0)]]}))
    assert {"0", "1M", "4M"} <= shown
    assert "1e6" not in shown


@pytest.mark.parametrize("crashed", [True, False])
def test_hollow_points_are_explained_where_there_are_any(crashed: bool) -> None:
    shown = texts(mismatch_lines({"mass": {"ppo": [(1.0, 2.0, False), (1.2, 3.0, crashed)]}}))
    assert any("crashed" in text for text in shown) == crashed
