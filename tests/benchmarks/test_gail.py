"""The study of imitation without reward: what it trains, and how it judges."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from aerial_il.benchmarks import gail
from aerial_il.benchmarks.gail import Gail, Point
from aerial_il.benchmarks.parts import ratios
from aerial_il.core.errors import InvalidValueError


def result(*returns: float) -> Any:
    """Stand in for an evaluation."""
    return SimpleNamespace(episodes=[SimpleNamespace(return_=value, success=value > 50) for value in returns])


def test_every_task_has_learners_and_both_controls() -> None:
    study = Gail(outside=("Hopper-v5",), suite={"reach": 250}, seeds=2, methods=("dac", "gail"))
    points = study.points()
    assert Point("Hopper-v5", "gail", "none", 1) in points
    assert {p.method for p in points if p.task == "Hopper-v5"} == {"dac", "gail", gail.CLONE}
    assert {p.method for p in points if p.task == "reach"} == {"gail", gail.CLONE}
    assert {p.control for p in points if p.task == "reach"} == {"none", "random_actions", "constant_reward"}
    assert len({p.place for p in points}) == len(points)
    assert [p.seed for p in points] == sorted(p.seed for p in points)
    apart = replace(study, apart={"Hopper-v5": {"seeds": 1, "controls": 0}}).points()
    assert {(p.control, p.seed) for p in apart if p.task == "Hopper-v5"} == {("none", 0)}
    assert [p for p in apart if p.task == "reach"] == [p for p in points if p.task == "reach"]


def test_a_learner_is_told_its_task_and_its_control() -> None:
    study = Gail(
        apart={"reach": {"steps": 123}},
        subsample=20,
        suite_gail={"bounds": "demonstrations", "rollout": 64, "cloning": 9},
    )
    own = study._learner(Point("reach", "gail", "constant_reward", 0))
    assert (own.steps, own.subsample, own.bounds, own.control) == (123, 1, "demonstrations", "constant_reward")
    clone = study._learner(Point("reach", gail.CLONE, "none", 0))
    assert (clone.steps, clone.warmup, clone.cloning) == (64, 64, 9), "reinforcement never moves it"
    outside = study._learner(Point("Hopper-v5", "dac", "none", 0))
    assert (outside.subsample, outside.bounds, outside.control) == (20, "environment", "none")
    clone = study._learner(Point("Hopper-v5", gail.CLONE, "none", 0))
    assert clone.steps < clone.warmup, "nor here"


def test_experts_that_were_kept_are_taken(tmp_path: Path) -> None:
    study = Gail(experts=str(tmp_path / "kept"))
    assert study._expert_run("Hopper-v5", tmp_path) == tmp_path / "experts" / "Hopper-v5"
    (tmp_path / "kept" / "Hopper-v5" / "policy").mkdir(parents=True)
    assert study._expert_run("Hopper-v5", tmp_path) == tmp_path / "kept" / "Hopper-v5"
    assert Gail(experts=None)._expert_run("Hopper-v5", tmp_path) == tmp_path / "experts" / "Hopper-v5"


def test_ratios_are_those_to_the_expert_and_targets_judge_the_first_method(tmp_path: Path) -> None:
    expert = result(100.0, 100.0)
    row = ratios.row("Hopper-v5", "dac", "none", [result(90.0, 110.0)], expert, [])
    assert row["ratio"] == 1.0
    assert row["ratio_low"] <= 1.0 <= row["ratio_high"]
    control = ratios.row("Hopper-v5", "dac", "random_actions", [result(1.0, 2.0)], expert, [])
    assert [target.met for target in ratios.targets([row, control])] == [True]
    reach = ratios.row("reach", "dac", "none", [result(90.0, 10.0)], expert, [])
    assert [target.met for target in ratios.targets([reach])] == [False]


def test_what_the_peer_reached_stands_in_the_same_table(tmp_path: Path) -> None:
    found = {"task": "Hopper-v5", "library": "peer", "seeds": 1, "steps": 10, "returns": [50.0, 50.0], "train_s": 60.0}
    (tmp_path / "Hopper-v5.json").write_text(json.dumps(found))
    expert = result(100.0, 100.0)
    (peer,) = ratios.peer_rows(tmp_path, {"Hopper-v5": expert})
    own = ratios.row("Hopper-v5", "dac", "none", [result(90.0)], expert, [])
    assert list(peer) == list(own)
    assert (peer["ratio"], peer["train_min"]) == (0.5, 1.0)
    assert not ratios.peer_rows(tmp_path, {})


def test_beside_a_peer_return_and_speed_are_judged() -> None:
    same = {"task": "Hopper-v5", "control": "none", "seeds": 1, "ratio": 0.5}
    own = {**same, "method": "gail", "return": 900.0, "steps": 1_000, "train_min": 1.0}
    peer = {**same, "method": "imitation 1.0.1 GAIL", "return": 600.0, "steps": 2_000, "train_min": 5.0}
    assert [(target.measured, target.met) for target in ratios.peer_targets([own, peer])] == [(1.5, True), (2.5, False)]
    assert not list(ratios.peer_targets([own]))


def test_impossible_settings_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="no method of this study"):
        Gail(methods=("bc",))
    with pytest.raises(InvalidValueError, match=r"apart.reach names \['sead'\]; valid: steps, seeds, controls"):
        Gail(apart={"reach": {"sead": 2}})
    with pytest.raises(InvalidValueError, match="start at 1"):
        Gail(seeds=0)
