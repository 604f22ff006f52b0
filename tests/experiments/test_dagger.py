"""The study of interactive learning: a small one runs, has its controls at equal cost, and is not flown twice."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.dagger import DAgger
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.policies.mlp import MLP
from experiments.common.demonstrations import Source
from experiments.dagger import study as dagger
from experiments.dagger.study import EPISODES, START, STEPS, Arm, Asked, Dagger
from tests.experiments.results import result_with

CLONING = BC(steps=10, batch_size=16)
SMALL: dict[str, Any] = {
    "policy": MLP(hidden=(16,)),
    "cloning": CLONING,
    "asking": {"dagger": DAgger(rounds=2, episodes=1, training=CLONING, between_steps=7, evaluate_every=0)},
    "arms": ("dagger",),
    "tasks": ("reach",),
    "demos": 2,
    "draws": (0,),
    "episodes": 1,
    "num_envs": 1,
    "threads": 1,
}


def test_a_small_study_tells_what_labels_cost_and_resumes(tmp_path: Path) -> None:
    report = Dagger(**SMALL).run(tmp_path, progress=False)
    rows = {row["arm"]: row for row in report.tables["Cloning and asking"]}
    assert list(rows) == [START, "dagger", EPISODES, STEPS]
    assert (rows[START]["episodes"], rows[START]["steps"]) == (2, 10)
    assert (rows["dagger"]["episodes"], rows["dagger"]["steps"]) == (4, 27)
    assert (rows[EPISODES]["episodes"], rows[EPISODES]["steps"]) == (4, 10)
    assert (rows[STEPS]["episodes"], rows[STEPS]["steps"]) == (4, 27)
    assert rows["dagger"]["labelled_steps"] == rows[START]["labelled_steps"] + rows["dagger"]["queries"]
    assert [target.limit for target in report.targets] == [95.0, 0.0]

    taken = [
        read_metrics(run.parent)[-1]["step"] for run in tmp_path.glob("training/dagger/**/rounds/*/training/policy")
    ]
    assert sum(taken) == rows["dagger"]["steps"], "the control takes as many steps as all rounds really did"

    files = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")}
    again = Dagger(**SMALL).run(tmp_path, progress=False)
    assert again.tables == report.tables
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")} == files


def flown(asked: int, cloned: int, draw: int) -> dict[Arm, Any]:
    source = Source(robot="fa_hexa_arm4", task="reach", draw=draw)
    training = Asked("dagger", source, 2, SMALL["policy"], SMALL["asking"]["dagger"])
    return {
        Arm("dagger", "", training): result_with(100, asked),
        Arm(STEPS, "dagger", training): result_with(100, cloned),
    }


def test_asking_that_is_worse_than_its_control_misses_its_target() -> None:
    results = flown(90, 95, 0) | flown(92, 95, 1)
    (row,) = dagger.differences_of(list(dagger.grouped_by(results)), results)
    assert (row["control"], row["difference"], row["draws"]) == (STEPS, -4.0, 2)
    assert row["low"] < -4.0 < row["high"]
    assert [target.met for target in dagger.beside_control([row])] == [False]
    assert [target.met for target in dagger.beside_control([{**row, "difference": 0.5}])] == [True]


def test_each_way_of_asking_has_controls_of_its_own_cost() -> None:
    study = Dagger()
    study = replace(study, arms=("dagger", "dart"), draws=(0,), tasks=("reach",))
    arms = {(arm.name, arm.control_of): arm.training for arm in study.all_arms()}
    for name in ("dagger", "dart"):
        asked, control = arms[name, ""], arms[STEPS, name]
        assert (control.demos, control.algorithm.steps) == (asked.episodes, asked.steps)
        assert arms[EPISODES, name].algorithm.steps < control.algorithm.steps
