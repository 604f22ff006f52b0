"""``aerial-il bench`` as a user types it."""

import json
import shlex
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from aerial_il.cli.commands.project import bench
from aerial_il.cli.main import main
from aerial_il.core import registry
from aerial_il.policies.mlp import MLP
from experiments.learning_curve.study import LearningCurve

SETTINGS = (
    "bench.robots=[fa_hexa_arm4]",
    "bench.tiers=[calm]",
    "bench.seeds=1",
    "bench.settle_s=0.1",
    "bench.duration_s=0.1",
)


def test_one_json_object_and_a_page_with_its_command(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "aerial_il", "bench", "tracking", *SETTINGS, "save=true", "--json"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)["benchmark"] == "tracking"
    study = json.loads((tmp_path / "experiments" / "tracking" / "results.json").read_text())
    assert set(shlex.split(study["command"])) == {"aerial-il", "bench", "tracking", *SETTINGS, "save=true"}
    assert (tmp_path / "experiments" / "tracking" / "README.md").exists()
    assert (tmp_path / "runs" / "benchmarks" / "tracking" / "report.json").exists()


def test_the_command_names_only_what_differs_from_the_study() -> None:
    study = LearningCurve()
    assert bench.rerun(study) == "aerial-il bench learning_curve save=true"
    said = bench.rerun(replace(study, policy=MLP(chunk=5, hidden=(8, 8))))
    assert shlex.split(said)[3:] == ["bench.policy.chunk=5", "bench.policy.hidden=[8,8]", "save=true"]


def test_finished_work_is_forgotten_only_when_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    kept = tmp_path / "runs" / "benchmarks" / "tracking" / "kept"
    kept.parent.mkdir(parents=True)
    kept.touch()
    assert main(["bench", "tracking", *SETTINGS, "progress=false"]) == 0
    assert kept.exists()
    assert main(["bench", "tracking", *SETTINGS, "again=true", "progress=false"]) == 0
    assert not kept.exists()


def test_an_installed_package_says_where_studies_are_run(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    names = registry.names
    monkeypatch.setattr(registry, "names", lambda kind: () if kind == "study" else names(kind))
    assert main(["bench", "tracking"]) == 2
    said = capsys.readouterr().err
    assert "Studies are run from a checkout" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize(("verdict", "status"), [("holds", 0), ("DOES NOT HOLD", 1), ("not checked here", 0)])
def test_a_claim_that_does_not_hold_ends_with_status_1(
    verdict: str, status: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from experiments.common import claims

    row: dict[str, Any] = {"claim": "tracking: near", "verdict": verdict}
    monkeypatch.setattr(claims, "checked", lambda *_, **__: [row])
    assert main(["bench", "quick=true"]) == status
    assert ("1 of 1 claims do not hold: tracking: near." in capsys.readouterr().err) == bool(status)
