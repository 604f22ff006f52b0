"""A record keeps stages by name and settings: nothing is done twice, and what other code made is told."""

from __future__ import annotations

import json
import logging
from pathlib import Path

import pytest

from experiments.common.record import RECORD, Record, digest


def test_equal_settings_lie_in_one_place_and_others_elsewhere(tmp_path: Path) -> None:
    record = Record(tmp_path)
    place = record.place("training", "mlp/reach", {"steps": 10, "policy": {"chunk": 10}})
    assert record.place("training", "mlp/reach", {"policy": {"chunk": 10}, "steps": 10}) == place
    assert record.place("training", "mlp/reach", {"steps": 10, "policy": {"chunk": 20}}) != place
    assert digest({"a": 1}) != digest({"a": 2})


def test_a_stage_names_settings_commit_packages_and_machine(tmp_path: Path) -> None:
    made = json.loads((Record(tmp_path).place("training", "mlp", {"seed": 3}) / RECORD).read_text())
    assert made["settings"] == {"seed": 3}
    assert made["machine"]["cores"] >= 1
    assert {"mujoco", "torch"} <= set(made["packages"])
    assert "git" in made


def test_what_another_commit_made_counts_and_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file = Record(tmp_path).place("training", "mlp", {"seed": 3}) / RECORD
    made = json.loads(file.read_text())
    file.write_text(json.dumps({**made, "git": {"sha": "0123456789abcdef", "dirty": False}}))
    record = Record(tmp_path)
    assert record.notes() == []
    with caplog.at_level(logging.INFO):
        assert record.place("training", "mlp", {"seed": 3}) == file.parent
    assert "Results of commit 0123456789 are taken as they are; again=true makes them anew." in caplog.text
    assert record.notes() == ["Stages that were finished before were taken as they are, from commit 0123456789."]
