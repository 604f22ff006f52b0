"""Targets are judged, reports become studies, studies become one table."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from aerial_il.core.errors import InvalidValueError
from experiments.common.page import save_study
from experiments.common.report import Report, Target


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
    assert [target.to_row()["verdict"] for target in REPORT.targets] == ["met", "MISSED"]


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


def test_a_study_too_large_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match="bytes"):
        save_study(replace(REPORT, figures={"big.svg": "x" * 300_000}), tmp_path, command="one")
    assert not list(tmp_path.iterdir())
