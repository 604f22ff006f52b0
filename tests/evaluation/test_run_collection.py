"""Runs below a folder: found at any depth, filtered, sorted, and what is none of them named."""

from __future__ import annotations

from pathlib import Path

import pytest

from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.evaluation.run_collection import RunCollection, read_runs
from tests.presentation.pages.test_run_report import make_run


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Four runs in two sweeps, and what stands about in such folders."""
    for seed, rates in enumerate(((0.1, 0.9), (0.2, 0.7))):
        make_run(tmp_path / "a" / f"seed={seed}", seed=seed, rates=rates)
        make_run(tmp_path / "b" / f"seed={seed}", seed=seed, rates=(0.5, 0.3 + 0.1 * seed))
    (tmp_path / "a" / "half").mkdir()
    (tmp_path / "a" / "half" / "config.yaml").write_text("algorithm: bc\n")
    make_run(tmp_path / "a" / "cut", rates=())
    (tmp_path / "a" / "cut" / "metrics.jsonl").write_text('{"step": 1}\n{"st\n{"step": 3}\n')
    (tmp_path / "holiday").mkdir()
    (tmp_path / "holiday" / "photo.jpg").write_bytes(b"x")
    (tmp_path / "notes.txt").write_text("x")
    return tmp_path


def names(result: RunCollection) -> list[str]:
    return [result.name(run) for run in result.runs]


def test_runs_are_found_at_any_depth_and_all_else_is_named(folder: Path) -> None:
    result = read_runs(folder)
    assert names(result) == ["a/seed=0", "a/seed=1", "b/seed=0", "b/seed=1"]
    assert {str(place.relative_to(folder)): why[:12] for place, why in result.refused.items()} == {
        "a/cut": f"{folder}/a/cut/metrics.jsonl"[:12],
        "a/half": "half-written",
        "holiday": "holds no tra",
    }
    assert result.axes == {"seed": [0, 1]}
    row = result.rows[0]
    assert (row["run"], row["state"], row["seed"], row["success"]) == ("a/seed=0", "finished", 0, 0.9)
    assert all(set(other) == set(row) for other in result.rows)


def test_a_run_alone_and_an_empty_folder_are_collections_too(folder: Path, tmp_path: Path) -> None:
    assert names(read_runs(folder / "a" / "seed=0")) == ["."]
    empty = read_runs(folder / "holiday")
    assert (empty.rows, empty.refused, empty.where(["success>0.5"]).runs) == ([], {}, ())
    with pytest.raises(InvalidValueError, match="aerial-il train"):
        read_runs(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("conditions", "left"),
    [
        (["success>0.5"], ["a/seed=0", "a/seed=1"]),
        (["success<=0.3"], ["b/seed=0"]),
        (["seed=1", "run~a/*"], ["a/seed=1"]),
        (["seed!=1", "success>=0.9"], ["a/seed=0"]),
        (["state=finished", "success<0.35"], ["b/seed=0"]),
        (["state>3"], []),
        (["policy.name=nobody"], []),
    ],
)
def test_conditions_leave_what_fulfils_all_of_them(folder: Path, conditions: list[str], left: list[str]) -> None:
    assert names(read_runs(folder).where(conditions)) == left


def test_what_is_no_condition_is_answered(folder: Path) -> None:
    result = read_runs(folder)
    with pytest.raises(InvalidValueError, match="not a condition"):
        result.where(["success"])
    with pytest.raises(UnknownNameError, match="Did you mean 'success'"):
        result.where(["sucess>0.5"])
    with pytest.raises(UnknownNameError, match="Did you mean 'success'"):
        result.sorted_by("-sucess")


def test_runs_are_sorted_by_numbers_upwards_and_downwards(folder: Path) -> None:
    result = read_runs(folder)
    assert names(result.sorted_by("success")) == ["b/seed=0", "b/seed=1", "a/seed=1", "a/seed=0"]
    assert names(result.sorted_by("-success")) == ["a/seed=0", "a/seed=1", "b/seed=1", "b/seed=0"]
    make_run(folder / "c", rates=())
    assert names(read_runs(folder).sorted_by("-success"))[-1] == "c", "what was never flown stands last"


def test_links_are_not_followed(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    make_run(elsewhere / "run")
    (folder / "link").symlink_to(elsewhere)
    assert "link/run" not in names(read_runs(folder))
