"""The study of imitation: what is flown, what its tables say, and that it goes on where it was stopped."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from aerial_il.algorithms.bc import BehaviourCloning
from aerial_il.benchmarks import imitation
from aerial_il.benchmarks.imitation import Flight, Imitation, Training
from aerial_il.cli import conf
from aerial_il.cli.build import build
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.evaluation.metrics import EpisodeRecord
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.policies.mlp import MlpConfig

SMALL: dict[str, Any] = {
    "policies": {"mlp": MlpConfig(hidden=(16,))},
    "algorithms": {"mlp": BehaviourCloning(steps=10, batch_size=16)},
    "tasks": ("reach",),
    "demos": 2,
    "sizes": (1,),
    "trained_in": ("calm",),
    "flown_in": ("calm",),
    "episodes": 2,
    "num_envs": 2,
}


def test_every_task_with_an_end_effector_is_flown() -> None:
    study = build(conf.read_option("bench", "imitation"))
    flights = list(study._flights())
    assert len({flight.training.task for flight in flights}) == 10
    assert "hover" not in {flight.training.task for flight in flights}
    judged = [f for f in flights if f.training.demos == 80]
    assert {(f.training.tier, f.tier) for f in judged} == {(a, b) for a in ("calm", "gusts") for b in ("calm", "gusts")}
    scaling = [f for f in flights if f.training.demos != 80]
    assert {f.training.demos for f in scaling} == {10, 20, 40, 160}
    assert {(f.training.tier, f.tier) for f in scaling} == {("calm", "calm")}
    assert len(set(flights)) == len(flights)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"tasks": ("hover",)}, "task"),
        ({"methods": ("act",)}, "method"),
        ({"algorithms": {}}, "differ"),
        ({"first_demo": 9_999}, "run into"),
        ({"episodes": 0}, "start at 1"),
        ({"seeds": ()}, "at least one"),
        ({"flown_in": ("storm",)}, "storm"),
    ],
)
def test_impossible_settings_are_refused(wrong: dict[str, Any], said: str) -> None:
    with pytest.raises((InvalidValueError, UnknownNameError), match=said):
        Imitation(**{**SMALL, **wrong})


def result_with(episodes: int, successes: int) -> EvaluationResult:
    records = [
        EpisodeRecord(
            seed=seed,
            end="success" if seed < successes else "timeout",
            steps=100,
            duration_s=2.0,
            time_to_success_s=2.0 if seed < successes else None,
            return_=1.0,
            mean_reward=0.5,
            ee_error_mean_m=None,
            ee_error_max_m=None,
            effort_mean=0.3,
            action_jerk_rms={},
            contact_events=0,
            contact_time_s=0.0,
            subtasks={},
        )
        for seed in range(episodes)
    ]
    return EvaluationResult("fa_hexa_arm4", "reach", "calm", "mlp", tuple(records), {"wall_time_s": 1.0})


def flown(*rates: tuple[str, str, int, int]) -> dict[Flight, EvaluationResult]:
    """Return evaluations of 20 episodes by (method, task, seed, successes)."""
    return {
        Flight(Training(method, task, "calm", 2, seed), "calm"): result_with(20, count)
        for method, task, seed, count in rates
    }


def test_the_mean_counts_tasks_alike_and_names_the_worst() -> None:
    results = flown(("mlp", "reach", 0, 20), ("mlp", "reach", 1, 10), ("mlp", "track", 0, 4), ("mlp", "track", 1, 6))
    row = imitation._macro_row(results)
    assert (row["tasks"], row["seeds"], row["percent"], row["worst"]) == (2, 2, 50.0, "track (25 %)")
    assert row["ci95_low"] < 50 < row["ci95_high"]


def test_targets_are_judged_over_all_tasks_only() -> None:
    study = Imitation(**SMALL)
    macro = [{"method": "mlp", "trained_in": "calm", "flown_in": "calm", "percent": 85.0, "tasks": 10}]
    macro = [{**macro[0], "ci95_low": 80.0, "ci95_high": 90.0}]
    assert study._targets(macro) == []
    targets = replace(study, tasks=())._targets(macro)
    assert [(t.limit, t.met) for t in targets] == [(80.0, True), (90.0, False)]


@pytest.mark.slow
def test_it_goes_on_where_it_was_stopped(tmp_path: Path) -> None:
    report = Imitation(**SMALL).run(tmp_path, progress=False)
    assert [row["demos"] for row in report.tables["Success over demonstrations"]] == [1, 1, 2, 2]
    assert set(report.figures) == {"tasks.svg", "demonstrations.svg"}
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("evaluation.json")}
    assert len(kept) == 2
    again = Imitation(**SMALL).run(tmp_path, progress=False)
    assert {path: path.stat().st_mtime_ns for path in kept} == kept
    assert json.dumps(again.tables) == json.dumps(report.tables)
    other = {**SMALL, "policies": {"mlp": MlpConfig(hidden=(8,))}}
    with pytest.raises(InvalidValueError, match="other settings"):
        Imitation(**other).run(tmp_path, progress=False)
