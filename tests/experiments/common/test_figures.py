"""What figures show can be told from one another, and read off."""

from __future__ import annotations

import re
from typing import Any

import pytest

from experiments.common.figures import mismatch_lines
from experiments.from_prior.lines import looks_of

ARMS = ("expert_iteration", "filtered_bc", "bc_ppo", "residual", "dapg", "jsrl", "ibrl", "rlpd", "ppo")
CLONES = ("bc, first", "bc, as practice begins", "bc, many")


CELL: tuple[str, int] = ("pick_place", 10)


def final(arm: str, flown: int = 1000) -> dict[str, Any]:
    """A final policy that solves 90 %."""
    ends = {"percent": 90.0, "flights_low": 85.0, "flights_high": 93.0}
    return {"arm": arm, "task": CELL[0], "demos": CELL[1], "flown": flown, **ends}


def texts(svg: str) -> set[str]:
    return set(re.findall(r">([^<>\n]+)</text>", svg))


def test_no_two_arms_look_alike() -> None:
    looks = looks_of([*(final(arm) for arm in ARMS), *(final(arm, flown=0) for arm in CLONES)])
    assert len({(look.colour, look.marker) for look in looks.values()}) == len({look.colour for look in looks.values()})
    assert len({look.marker for look in looks.values()}) == len(ARMS) + len(CLONES)


@pytest.mark.parametrize("crashed", [True, False])
def test_hollow_points_are_explained_where_there_are_any(crashed: bool) -> None:
    shown = texts(mismatch_lines({"mass": {"ppo": [(1.0, 2.0, False), (1.2, 3.0, crashed)]}}))
    assert any("crashed" in text for text in shown) == crashed
