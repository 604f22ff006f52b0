"""Targets are judged, reports become studies with tables and figures that can be read."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from experiments.common.columns import markdown
from experiments.common.page import save_study
from experiments.common.report import Report, Target
from experiments.from_prior.lines import looks_of


@dataclass(frozen=True)
class Made:
    """A study of that name."""

    name: str = "tracking"
    question: str = "How close?"
    seeds: int = 2

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        raise NotImplementedError


REPORT = Report(
    study=Made(),
    targets=(Target("error", "at most", 2.0, 1.234, "cm", "SD 0.1 cm"), Target("ratio", "at least", 5.0, 4.9)),
    tables={"Errors": [{"robot": "quad", "rmse_cm": 1.234, "time_s": None}]},
    notes=("With a ruler.",),
    figures={"tracking.svg": "<svg/>"},
    wall_time_s=12.3,
)


@pytest.mark.parametrize(
    ("sense", "measured", "met"),
    [("at most", 2.0, True), ("at most", 2.1, False), ("at least", 2.0, True), ("at least", 1.9, False)],
)
def test_a_target_is_met_up_to_its_limit(sense: str, measured: float, met: bool) -> None:
    assert Target("x", sense, 2.0, measured).met is met  # pyright: ignore[reportArgumentType]


def test_the_verdict_counts_and_a_missed_target_is_loud() -> None:
    assert REPORT.verdict == "1 of 2 targets met"
    assert [target.to_row()["verdict"] for target in REPORT.targets] == ["met", "not met"]


def test_a_study_says_what_was_measured_how_and_where(tmp_path: Path) -> None:
    page = save_study(REPORT, tmp_path, command="aerial-il bench tracking save=true").read_text()
    for said in (
        "How close?",
        "1 of 2 targets met",
        "```bash\naerial-il bench tracking save=true\n```",
        "| error | at most 2 cm | 1.23 cm | SD 0.1 cm | met |",
        "| robot | rmse cm | time s |\n| --- | ---: | ---: |\n| quad | 1.234 |  |",
        "![Tracking](tracking.svg)",
        "- With a ruler.",
        "12 s",
    ):
        assert said in page
    assert (tmp_path / "tracking" / "tracking.svg").read_text() == "<svg/>"
    kept = json.loads((tmp_path / "tracking" / "results.json").read_text())
    assert kept["targets"][1] == {
        "what": "ratio", "sense": "at least", "limit": 5.0, "measured": 4.9, "unit": "", "spread": "", "met": False
    }  # fmt: skip


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


ARMS = ("expert_iteration", "filtered_bc", "bc_ppo", "residual", "dapg", "jsrl", "ibrl", "rlpd", "ppo")
CLONES = ("bc, first", "bc, as practice begins", "bc, many")


CELL: tuple[str, int] = ("pick_place", 10)


def final(arm: str, flown: int = 1000) -> dict[str, Any]:
    """A final policy that solves 90 %."""
    ends = {"percent": 90.0, "flights_low": 85.0, "flights_high": 93.0}
    return {"arm": arm, "task": CELL[0], "demos": CELL[1], "flown": flown, **ends}


def test_no_two_arms_look_alike() -> None:
    looks = looks_of([*(final(arm) for arm in ARMS), *(final(arm, flown=0) for arm in CLONES)])
    assert len({(look.colour, look.marker) for look in looks.values()}) == len({look.colour for look in looks.values()})
    assert len({look.marker for look in looks.values()}) == len(ARMS) + len(CLONES)
