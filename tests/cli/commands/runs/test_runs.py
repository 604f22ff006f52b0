"""The command over many runs: what it lists, compares and draws, and what it never removes."""

import fcntl
import json
from pathlib import Path

import pytest

from aerial_il.cli.main import main
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.run_collection import read_runs
from tests.evaluation.conftest import diver as diver
from tests.presentation.outline import Outline
from tests.presentation.pages.test_run_report import make_run


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for seed, rate in enumerate((0.9, 0.7, 0.2)):
        make_run(tmp_path / "runs" / f"seed={seed}", seed=seed, rates=(0.1, rate))
    (tmp_path / "runs" / "foreign").mkdir()
    (tmp_path / "runs" / "foreign" / "thesis.tex").write_text("x")
    return tmp_path / "runs"


def test_it_lists_what_fulfils_the_conditions_and_names_the_rest(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["runs", str(folder), "where=success>0.5", "sort=success"]) == 0
    said = capsys.readouterr()
    assert [line.split()[0] for line in said.out.splitlines()[2:]] == ["seed=1", "seed=0"]
    assert "foreign: holds no training run" in said.err


def test_json_has_rows_axes_and_what_was_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["runs", str(folder), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert [row["success"] for row in result["runs"]] == [0.9, 0.7, 0.2]
    assert result["axes"] == {"seed": [0, 1, 2]}
    assert list(result["refused"]) == [str(folder / "foreign")]


def test_evaluations_are_listed_with_their_success(
    folder: Path, diver: EvaluationResult, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    diver.save(folder / "seed=1" / "gusts")
    diver.save(folder / "foreign" / "deep" / "evaluation")
    diver.save(folder / "trash" / "old")
    (folder / "broken").mkdir()
    (folder / "broken" / "evaluation.json").write_text("{}")
    assert main(["runs", str(folder)]) == 0
    said = capsys.readouterr()
    runs, evaluations = said.out.split("\n\n")
    assert "seed=2" in runs
    assert [line.split()[0] for line in evaluations.splitlines()[2:]] == ["foreign/deep/evaluation", "seed=1/gusts"]
    low, high = (f"{100 * end:.1f}" for end in diver.success["ci95"])
    cells = [cell.strip() for cell in evaluations.splitlines()[-1].split("  ") if cell]
    assert cells[-3:] == [f"{100 * diver.success['rate']:.1f} %", f"{low} to {high} %", "40"]
    assert "foreign: holds no training run" not in said.err
    assert "broken" in said.err
    assert main(["runs", str(folder), "where=seed>0", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["evaluations"]
    assert [(row["evaluation"], row["policy"], row["episodes"]) for row in rows] == [("seed=1/gusts", "diver", 40)]


def test_tables_fit_the_terminal(
    folder: Path, diver: EvaluationResult, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for place in "abc":
        diver.save(folder / place)
    whole = ""
    commands = (["runs", str(folder)], ["list", "declined=true"], ["compare", *(str(folder / each) for each in "abc")])
    for words in commands:
        for columns in (80, 130):
            monkeypatch.setenv("COLUMNS", str(columns))
            assert main(words) == 0
            assert max(map(len, capsys.readouterr().out.splitlines())) <= columns
        monkeypatch.delenv("COLUMNS")
        assert main(words) == 0
        whole = capsys.readouterr().out
    assert max(map(len, whole.splitlines())) > 130, "no terminal: each line is whole"


def test_columns_are_chosen_among_results_and_settings(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["runs", str(folder), "columns=[success,algorithm]"]) == 0
    assert capsys.readouterr().out.splitlines()[0].split() == ["run", "success", "algorithm"]


def test_a_comparison_has_a_column_for_each_run(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["runs", str(folder), "where=seed<2", "compare=true"]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert lines[0] == ["seed=0", "seed=1"]
    assert ["seed", "0", "1"] in lines
    assert ["success", "0.9", "0.7"] in lines
    assert main(["runs", str(folder), "where=seed=0", "compare=true"]) == 2


def test_the_page_has_axes_curves_and_table(folder: Path) -> None:
    assert main(["runs", str(folder), "page=true"]) == 0
    html = (folder / "report.html").read_text()
    assert {"axes", "rollouts", "loss", "runs", "refused"} <= set(Outline(html).ids)
    assert "Success at the end by seed: 0 90 %, 1 70 %, 2 20 %" in html
    assert "http://" not in html.replace("http://www.w3.org", "")


def test_pruned_runs_go_to_the_trash_and_nothing_else_does(folder: Path) -> None:
    assert main(["runs", str(folder), "where=success<0.8", "prune=trash"]) == 0
    assert sorted(path.name for path in folder.iterdir()) == ["foreign", "seed=0", "trash"]
    assert sorted(path.name for path in (folder / "trash").iterdir()) == ["seed=1", "seed=2"]
    assert (folder / "trash" / "seed=1" / "config.yaml").is_file()
    make_run(folder / "seed=1", seed=1, rates=(0.1, 0.7))
    assert main(["runs", str(folder), "where=seed=1", "prune=trash"]) == 0
    assert sorted(path.name for path in (folder / "trash").iterdir()) == ["seed=1", "seed=1.1", "seed=2"]


def test_a_run_in_which_another_lies_is_left_alone(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make_run(folder / "seed=1" / "finetuned", seed=1, rates=(0.1, 0.7))
    make_run(folder / "seed=2" / "prior", seed=2, rates=(0.1, 0.7))  # its own beginning
    assert main(["runs", str(folder), "where=success<0.8", "prune=delete"]) == 0
    assert "left alone, another run lies in it" in capsys.readouterr().out
    assert (folder / "seed=1" / "finetuned" / "config.yaml").exists()
    assert not (folder / "seed=2").exists()


def test_deleting_needs_conditions_and_spares_what_is_no_run(folder: Path) -> None:
    assert main(["runs", str(folder), "prune=delete"]) == 2
    assert main(["runs", str(folder), "where=success>0.5", "prune=all"]) == 2
    assert main(["runs", str(folder), "where=success>=0", "prune=delete"]) == 0
    assert [path.name for path in folder.iterdir()] == ["foreign"]
    assert (folder / "foreign" / "thesis.tex").is_file()


def test_a_folder_that_is_itself_a_run_is_not_pruned(folder: Path) -> None:
    assert main(["runs", str(folder / "seed=0"), "where=seed=0", "prune=delete"]) == 2
    assert (folder / "seed=0" / "config.yaml").is_file()


def test_a_run_that_is_being_trained_is_left_alone(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with open(folder / "seed=1" / ".lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert main(["runs", str(folder), "where=seed>=0", "prune=delete"]) == 0
    assert "being trained" in capsys.readouterr().out
    assert sorted(path.name for path in folder.iterdir()) == ["foreign", "seed=1"]


def test_what_is_not_equal_is_the_rest_of_what_is(folder: Path) -> None:
    """Values of settings have types; a condition is text. What is removed by one is what the other keeps."""
    for wanted in ("seed=0", "algorithm.hidden=[256, 256]", "success=0.9", "algorithm.lr=0.001", "policy.name=mlp"):
        if "hidden" in wanted:
            make_run(folder / "wide", seed=7, hidden=[256, 256])
        runs = read_runs(folder)
        equal, other = (
            {run.path for run in runs.where([each]).runs} for each in (wanted, wanted.replace("=", "!=", 1))
        )
        assert equal
        assert not equal & other
        assert equal | other == {run.path for run in runs.runs}


def test_an_evaluation_called_like_a_column_hides_none(folder: Path, diver: EvaluationResult) -> None:
    for name in ("success", "seed"):
        diver.save(folder / "seed=2" / name)
    row = read_runs(folder).rows[2]
    assert (row["success"], row["seed"]) == (0.2, 2)
    assert row["evaluation/success"] == row["evaluation/seed"] == diver.success["rate"]


def test_a_page_of_chosen_runs_says_so(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["runs", str(folder), "where=success>0.5", "page=true"]) == 0
    assert "Chosen of 3 runs: success&gt;0.5." in (folder / "report.html").read_text()
    assert main(["runs", str(folder), "page=true"]) == 0
    assert "Chosen of" not in (folder / "report.html").read_text()


def test_what_is_in_the_trash_stands_in_no_ranking(
    folder: Path, diver: EvaluationResult, capsys: pytest.CaptureFixture[str]
) -> None:
    for place in ("seed=0/evaluation", "seed=1/evaluation", "seed=2/evaluation", "trash/seed=3/evaluation"):
        diver.save(folder / place)
    assert main(["compare", str(folder)]) == 0
    assert "seed=3" not in capsys.readouterr().out
    assert main(["leaderboard", str(folder), "fewest=1", f"out={folder / 'board.html'}"]) == 0
    assert "seed=3" not in (folder / "board.html").read_text()
