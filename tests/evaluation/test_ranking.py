"""Several evaluations in one ranking: by rate, each against the best, with p-values for how many there are."""

import csv
import io
from pathlib import Path

import pytest

from aerial_il.cli.main import main
from aerial_il.evaluation import statistics
from aerial_il.evaluation.ranking import rank
from aerial_il.evaluation.result import load_result
from tests.experiments.results import result_with


@pytest.fixture
def sweep(tmp_path: Path) -> Path:
    for name, won in {"bad": 20, "good": 90, "middle": 70, "other": 88}.items():
        result_with(100, won).save(tmp_path / name)
    return tmp_path


def test_the_best_is_first_and_all_are_tested_against_it(sweep: Path) -> None:
    ranking = rank({name: load_result(sweep / name) for name in ("bad", "good", "middle", "other")})
    assert [place.name for place in ranking.places] == ["good", "other", "middle", "bad"]
    best, other, middle, bad = ranking.places
    assert (best.success, best.episodes, best.p_adjusted) == (90, 100, None)
    assert best.ci95 == statistics.wilson(90, 100)
    assert bad.difference == pytest.approx(-0.7)
    raw = [place.p_value for place in (other, middle, bad)]
    assert [place.p_adjusted for place in (other, middle, bad)] == pytest.approx(statistics.holm(raw))
    assert other.p_adjusted is not None
    assert other.p_adjusted > 0.05


def test_a_folder_stands_for_all_evaluations_in_it(sweep: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", str(sweep)]) == 0
    said = capsys.readouterr().out
    assert said.index("good") < said.index("other") < said.index("middle") < said.index("bad")
    assert "Holm" in said
    assert main(["compare", str(sweep), "format=csv"]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert [row["success"] for row in rows] == ["90 of 100", "88 of 100", "70 of 100", "20 of 100"]
    assert main(["compare", str(sweep), "format=latex"]) == 0
    text = capsys.readouterr().out
    assert text.count(r"\\") == 5
    assert r"90.0 \%" in text


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["good"], "holds 1 evaluation"),
        (["good", "bad", "format=csv"], "is of a ranking"),
        (["good", "nowhere"], "nowhere"),
        (["good", "bad", "format=table"], "text, csv, latex"),
    ],
)
def test_what_cannot_be_ranked_is_refused(
    words: list[str], said: str, sweep: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(sweep)
    assert main(["compare", *words]) == 2
    assert said in capsys.readouterr().err
