"""``aerial-il report`` as tables for a paper, and what it does where a folder is missing."""

import csv
import io
from dataclasses import replace
from pathlib import Path

import pytest

from aerial_il.cli.main import main
from aerial_il.evaluation.result import EvaluationResult
from tests.data.test_joined import transitions
from tests.evaluation.conftest import diver as diver
from tests.presentation.pages.test_run_report import make_run


@pytest.fixture
def folder(tmp_path: Path, diver: EvaluationResult, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for seed in (0, 1):
        make_run(tmp_path / "runs" / f"seed={seed}", seed=seed)
    diver.save("runs/seed=1/gusts")
    return tmp_path


def printed(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    assert main(["report", *words]) == 0
    return capsys.readouterr().out


def test_runs_become_a_row_for_each_evaluation(
    folder: Path, diver: EvaluationResult, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = list(csv.DictReader(io.StringIO(printed(["runs", "format=csv"], capsys))))
    assert [(row["run"], row["seed"], row["evaluation"]) for row in rows] == [
        ("runs/seed=0", "0", ""),
        ("runs/seed=1", "1", "gusts"),
    ]
    assert rows[1]["episodes"] == str(len(diver.episodes))
    rates = [float(rows[1][name]) for name in ("success", "low", "high")]
    assert rates == pytest.approx([diver.success["rate"], *diver.success["ci95"]], abs=1e-3)


def test_an_evaluation_becomes_a_row_for_each_number(
    folder: Path, diver: EvaluationResult, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = list(csv.DictReader(io.StringIO(printed(["runs/seed=1/gusts", "format=csv"], capsys))))
    steps = next(row for row in rows if row["number"] == "steps")
    assert float(steps["mean"]) == pytest.approx(diver.metrics["steps"]["mean"], rel=1e-3)
    latex = printed(["runs/seed=1/gusts", "format=latex"], capsys)
    assert latex.startswith(r"\begin{tabular}{llll}")
    assert r"action\_jerk\_rms[m/s\textasciicircum{}3]" in latex
    assert not list(folder.rglob("*.html"))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["runs/seed=0", "runs/nowhere"], "runs/nowhere does not exist"),
        (["runs/seed=0", "runs/nowhere", "format=csv"], "runs/nowhere does not exist"),
        (["runs/nowhere", "format=csv"], "runs/nowhere: cannot be read"),
        (["runs/seed=0", "runs/seed=1/gusts"], "ranked by aerial-il compare"),
        (["runs/seed=1/gusts", "learning_curve={0:runs/seed=1/gusts}"], "0 demonstrations; their number starts at 1"),
        (
            ["runs/seed=1/gusts", "learning_curve={10:runs/seed=1/gusts,20:runs/seed=1/other}"],
            "not of one robot, task and tier (10: crane reach calm, 20: crane reach hard)",
        ),
        (["runs", "format=latex", "out=table.tex"], "leave out out=, and add > table.tex"),
    ],
)
def test_what_is_missing_is_named_and_nothing_is_written(
    folder: Path, diver: EvaluationResult, words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    replace(diver, tier="hard").save("runs/seed=1/other")
    before = sorted(folder.rglob("*"))
    assert main(["report", *words]) == 2
    answer = capsys.readouterr()
    assert said in answer.err
    assert not answer.out
    assert sorted(folder.rglob("*")) == before


def test_a_run_on_several_datasets_is_shown_on_what_it_held_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for episodes, name in enumerate(("a", "b"), start=3):
        transitions(tmp_path / f"{name}.npz", episodes)
    run, others = str(tmp_path / "run"), f"dataset.others=[{tmp_path / 'b.npz'}]"
    words = [f"dataset={tmp_path / 'a.npz'}", others, "dataset.weights=[1,2]", "algorithm.steps=1", "progress=false"]
    assert main(["train", *words, "threads=1", f"run={run}"]) == 0
    assert main(["report", run, "videos=0"]) == 0
    assert "no longer, the dataset" not in (tmp_path / "run/report.html").read_text()
