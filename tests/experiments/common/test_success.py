"""The learning curve, in a tiny setting: a point for each size, each trained on draws of its own."""

import json
from pathlib import Path

import pytest

import aerial_il
from aerial_il.algorithms.bc import BC
from aerial_il.policies import load_policy
from aerial_il.policies.mlp import MLP
from experiments.common.report import Report
from experiments.common.success import pooled_row
from experiments.learning_curve.study import LearningCurve
from tests.experiments.results import result_with

TINY = LearningCurve(
    policy=MLP(hidden=(8,)),
    algorithm=BC(steps=3, batch_size=8, validation=0.0),
    sizes=(1, 2),
    robots=("ua_quad_arm4",),
    tasks=("reach",),
    draws=(0, 1),
    episodes=1,
    threads=1,
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("learning_curve")


@pytest.fixture(scope="module")
def report(folder: Path) -> Report:
    return TINY.run(folder, progress=False)


def test_the_curve_has_a_point_for_each_size(report: Report) -> None:
    rows = report.tables["Success over demonstrations"]
    assert [row["demos"] for row in rows] == [1, 2]
    assert all((row["train_steps"], row["trainings"], row["episodes"]) == (3, 2, 2) for row in rows)
    assert report.wall_time_s > 0.0
    json.dumps(report.to_dict(), allow_nan=False)


def test_each_size_takes_the_first_of_its_draw(report: Report, folder: Path) -> None:
    for draw, size in ((0, 1), (0, 2), (1, 1), (1, 2)):
        (run,) = folder.glob(f"training/mlp/ua_quad_arm4-reach-calm/{size}/{draw}-*")
        assert load_policy(run).origin["dataset"]["demonstrations"] == size
    for draw in (0, 1):
        (dataset,) = folder.glob(f"datasets/ua_quad_arm4-reach-calm/{draw}-*")
        demos = aerial_il.open_dataset(str(dataset))
        assert [episode.provenance["seed"] for episode in demos] == [100_000 * draw, 100_000 * draw + 1]


def test_the_interval_over_trainings_is_the_wider() -> None:
    row = pooled_row([result_with(100, count) for count in (90, 70, 50)])
    assert (row["trainings"], row["success"], row["percent"], row["worst"], row["best"]) == (3, 210, 70.0, 50.0, 90.0)
    assert row["trainings_low"] < row["flights_low"] < 70 < row["flights_high"] < row["trainings_high"] == 100.0
    alone = pooled_row([result_with(100, 90)])
    assert (alone["trainings_low"], alone["trainings_high"]) == (None, None)
