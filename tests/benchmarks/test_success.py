"""Benchmarks that fly episodes: experts and the learning curve, in tiny settings."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

import aerial_il
from aerial_il.algorithms.bc import BehaviourCloning
from aerial_il.benchmarks.experts import Experts
from aerial_il.benchmarks.learning_curve import LearningCurve
from aerial_il.benchmarks.parts.report import Report
from aerial_il.core.errors import InvalidValueError
from aerial_il.evaluation.result import load_result
from aerial_il.policies.mlp import MlpConfig

TINY = LearningCurve(
    policy=MlpConfig(hidden=(8,)),
    algorithm=BehaviourCloning(steps=3, batch_size=8, validation=0.0),
    sizes=(1, 2),
    robots=("ua_quad_arm4",),
    tasks=("reach",),
    episodes=1,
    threads=1,
)


EXPERTS = Experts(tasks=("reach",), tiers=("calm",), episodes=1, returns=2, threads=1)


def test_experts_fly_every_cell_keep_each_evaluation_and_go_on_with_the_rest(tmp_path: Path) -> None:
    report = replace(EXPERTS, robots=("ua_quad_arm4",)).run(tmp_path, progress=False)
    (row,) = report.tables["Success of the experts"]
    assert (row["robot"], row["task"], row["tier"], row["success"]) == ("ua_quad_arm4", "reach", "calm", 1)
    assert load_result(tmp_path / "ua_quad_arm4-reach-calm").seeds == [10_000]
    (earned,) = report.tables["Returns"]
    assert earned["sparse_is_success"]
    assert earned["expert_return"] > earned["random_return"] > 0.0
    assert [target.limit for target in report.targets] == [99.0, 1.0]
    assert all(target.met for target in report.targets)
    json.dumps(report.to_dict(), allow_nan=False)

    kept = (tmp_path / "ua_quad_arm4-reach-calm" / "evaluation.json").read_bytes()
    again = EXPERTS.run(tmp_path, progress=False)
    reaching = [cell for cell in aerial_il.list_cells() if cell[1] == "reach"]
    assert [(row["robot"], row["task"]) for row in again.tables["Success of the experts"]] == reaching
    assert (tmp_path / "ua_quad_arm4-reach-calm" / "evaluation.json").read_bytes() == kept
    with pytest.raises(InvalidValueError, match="other settings"):
        replace(EXPERTS, episodes=2).run(tmp_path, progress=False)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("learning_curve")


@pytest.fixture(scope="module")
def report(folder: Path) -> Report:
    return TINY.run(folder, progress=False)


def test_the_curve_has_a_point_for_each_size(report: Report) -> None:
    rows = report.tables["Success over demonstrations"]
    assert [row["demos"] for row in rows] == [1, 2]
    assert all(row["train_steps"] == 3 and row["episodes"] == 1 for row in rows)
    assert report.wall_time_s > 0.0
    json.dumps(report.to_dict(), allow_nan=False)


def test_each_size_learns_from_the_first_demonstrations(report: Report, folder: Path) -> None:
    for size in (1, 2):
        policy = aerial_il.load_policy(str(folder / "training" / "ua_quad_arm4-reach" / str(size)))
        assert policy.origin["dataset"]["demonstrations"] == size
    demos = aerial_il.open_dataset(str(folder / "datasets" / "ua_quad_arm4-reach"))
    assert [episode.provenance["seed"] for episode in demos] == [0, 1]


def test_what_is_done_is_not_done_again(report: Report, folder: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}
    again = TINY.run(folder, progress=False)
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert again.tables == report.tables
    assert again.wall_time_s == report.wall_time_s


def test_a_lost_stage_is_done_again_with_the_same_result(report: Report, folder: Path) -> None:
    for file in (folder / "evaluations" / "ua_quad_arm4-reach" / "2").iterdir():
        file.unlink()
    again = TINY.run(folder, progress=False)
    same = [{k: v for k, v in row.items() if k != "train_min"} for row in report.tables["Success over demonstrations"]]
    assert [
        {k: v for k, v in row.items() if k != "train_min"} for row in again.tables["Success over demonstrations"]
    ] == same


def test_results_of_other_settings_are_not_mixed(report: Report, folder: Path) -> None:
    with pytest.raises(InvalidValueError, match=r"other settings \(episodes\)"):
        replace(TINY, episodes=2).run(folder, progress=False)


def test_demonstrations_may_not_run_into_the_seeds_of_evaluation() -> None:
    with pytest.raises(InvalidValueError, match="seeds of evaluation"):
        replace(TINY, seed=9_999)
