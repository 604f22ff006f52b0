"""Tables for people say in few cells what the numbers of a study say in many columns."""

from __future__ import annotations

from typing import Any

import pytest

from experiments.common.columns import markdown


def cells(*rows: dict[str, Any]) -> list[dict[str, str]]:
    """What a table shows: for each row title -> cell."""
    head, _, *lines = ([cell.strip() for cell in line.strip("| ").split(" |")] for line in markdown(rows).splitlines())
    return [dict(zip(head, line, strict=True)) for line in lines]


@pytest.mark.parametrize(
    ("row", "shown"),
    [
        ({"ratio": 0.9, "ratio_low": 0.8, "ratio_high": 1.0}, {"ratio (95 %)": "0.9 (0.8–1.0)"}),
        ({"difference": -3.0, "low": -7.3, "high": 1.3}, {"difference (95 %)": "-3.0 (-7.3 to 1.3)"}),
        ({"return": 5.0, "low": None, "high": None}, {"return (95 %)": "5.0"}),
        ({"return": 5.0, "worst_return": 4.0}, {"return": "5.0", "worst return": "4.0"}),
        ({"of_expert": None, "of_expert_low": None, "of_expert_high": None}, {"of expert (95 %)": ""}),
        ({"steps_per_s": 9, "slowest": 8, "fastest": 10}, {"steps per s (slowest–fastest)": "9 (8–10)"}),
        (
            {"flights": 3, "flights_low": 8, "flights_high": 9, "percent": 8},
            {"flights": "3", "percent (flights)": "8 (8–9)"},
        ),
        ({"episodes": 70, "success": 131, "flown": 300}, {"episodes": "70", "success": "131", "flown": "300"}),
        ({"percent": 9, "worst": "press_button (8 %)"}, {"percent": "9", "worst": "press_button (8 %)"}),
    ],
)  # fmt: skip
def test_an_interval_stands_beside_its_number(row: dict[str, Any], shown: dict[str, str]) -> None:
    assert cells(row) == [shown]
