"""The study of interactive learning: a small one runs, says what it cost, and is not flown twice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from aerial_il.algorithms.bc import BehaviourCloning
from aerial_il.benchmarks.dagger import START, Interactive
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.policies.mlp import MlpConfig

SMALL: dict[str, Any] = {
    "policy": MlpConfig(hidden=(16,)),
    "training": BehaviourCloning(steps=10, batch_size=16),
    "tasks": ("reach",),
    "arms": (START, "dagger"),
    "demos": 2,
    "rounds": 1,
    "episodes": 1,
    "between_steps": 10,
    "seeds": 1,
    "flown": 1,
    "num_envs": 1,
}


def test_a_small_study_tells_what_labels_cost_and_goes_on_where_it_stopped(tmp_path: Path) -> None:
    report = Interactive(**SMALL).run(tmp_path, progress=False)
    rows = {row["arm"]: row for row in report.tables["Cloning and asking"]}
    assert rows[START]["episodes"] == 2
    assert rows["dagger"]["episodes"] == 3
    assert rows["dagger"]["queries"] > 0
    assert rows["dagger"]["labelled_steps"] == rows[START]["labelled_steps"] + rows["dagger"]["queries"]
    (target,) = report.targets
    assert target.what.startswith("reach: DAgger")
    assert (target.limit, target.measured) == (95.0, rows["dagger"]["percent"])

    files = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")}
    again = Interactive(**SMALL).run(tmp_path, progress=False)
    assert again.tables == report.tables
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")} == files


@pytest.mark.parametrize(("wrong", "said"), [({"arms": ("magic",)}, "magic"), ({"rounds": 0}, "start at 1")])
def test_impossible_settings_are_refused(wrong: dict[str, Any], said: str) -> None:
    with pytest.raises((InvalidValueError, UnknownNameError), match=said):
        Interactive(**{**SMALL, **wrong})
