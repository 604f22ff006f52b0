"""The commands in the order of the work, on a small scale, each judged by what it leaves behind."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from aerial_il.cli.main import main

SCRIPT = Path(sys.executable).with_name("aerial-il")
QUIET = "progress=false"


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a dataset, a run trained on it and two evaluations."""
    folder = tmp_path_factory.mktemp("path")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(["collect", "task=reach", "episodes=6", "out=demos", QUIET]) == 0
        assert main(["train", "dataset=demos", "run=run", "experiment=quick", "algorithm.steps=40", QUIET]) == 0
        flown = ["evaluation=quick", "episodes=4", QUIET]
        assert main(["evaluate", "policy=run", "out=run/evaluation", *flown]) == 0
        assert main(["evaluate", "policy=expert", "robot=ua_quad_arm4", "task=reach", "out=expert", *flown]) == 0
    return folder


@pytest.fixture(autouse=True)
def at_home(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(home)


def test_recordings_are_sound_and_replay_bit_for_bit(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", str(home / "demos"), "replay=true", QUIET]) == 0
    said = capsys.readouterr().out
    assert "6 episodes, all sound" in said
    assert "every bit equal" in said


def test_info_describes_each_episode(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(home / "demos"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [e["seed"] for e in found["episodes"]] == list(range(6))
    assert (found["robot"], found["task"]) == ("ua_quad_arm4", "reach")


def test_collecting_more_flies_only_what_is_missing(home: Path) -> None:
    before = {file: file.stat().st_mtime_ns for file in (home / "demos" / "demos").iterdir()}
    assert main(["collect", "task=reach", "episodes=7", "out=demos", QUIET]) == 0
    after = {file: file.stat().st_mtime_ns for file in (home / "demos" / "demos").iterdir()}
    assert len(after) == 7
    assert all(after[file] == time_ns for file, time_ns in before.items())


def test_an_evaluation_says_how_to_get_it_again(home: Path) -> None:
    result = json.loads((home / "run" / "evaluation" / "evaluation.json").read_text())
    assert result["seeds"] == [10000, 10003]
    assert result["provenance"]["command"] == (
        "aerial-il evaluate policy=run robot=ua_quad_arm4 task=reach action=ee_pose "
        "tier=calm controller=geometric_observer episodes=4 seed=10000 out=run/evaluation"
    )


def test_a_report_gathers_run_and_dataset(home: Path) -> None:
    assert main(["report", "run/evaluation", "run=run", "dataset=demos", "out=page.html"]) == 0
    assert "http://" not in (home / "page.html").read_text().replace("http://www.w3.org", "")


def test_comparison_is_paired_by_seed(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", str(home / "expert"), str(home / "run" / "evaluation"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["paired"]
    assert 0 < found["p_value"] <= 1
    assert "paired by seed" in found["method"]


@pytest.fixture(scope="module")
def sweep(home: Path) -> Path:
    """Two training seeds, each with rollouts on the way."""
    words = ["train", "dataset=demos", "run=sweep", "experiment=quick", "algorithm.steps=4", "seed=0,1", "--multirun"]
    words += ["evaluate_every=2", "evaluate_episodes=1", "policy.hidden=[8]", QUIET]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(home)
        assert main(words) == 0
    return home / "sweep"


def test_rollouts_on_the_way_take_seeds_that_do_not_judge(sweep: Path) -> None:
    rows = [json.loads(line) for line in (sweep / "seed=0" / "metrics.jsonl").read_text().splitlines()]
    flown = [row for row in rows if "evaluate/success" in row]
    assert [row["step"] for row in flown] == [2, 4]
    assert flown[0]["evaluate/success_low"] <= flown[0]["evaluate/success"] <= flown[0]["evaluate/success_high"]
    assert (sweep / "seed=0" / "best").is_dir()
    kept = json.loads((sweep / "seed=1" / "command.json").read_text())
    learned_from = {"path": "demos", "episodes": None, "others": [], "weights": [], "latency_ms": None, "reading": {}}
    learned_from["language"] = False
    assert kept["dataset"] == learned_from
    assert "evaluate_every=2 evaluate_episodes=1" in kept["command"]


def test_a_run_and_a_sweep_are_reported(home: Path, sweep: Path) -> None:
    assert main(["report", "sweep/seed=0", "videos=0", "out=one.html"]) == 0
    assert 'id="predictions"' in (home / "one.html").read_text()
    assert "No predictions" not in (home / "one.html").read_text()
    assert main(["report", "sweep"]) == 0
    assert "2 runs, 1 configuration<" in (home / "sweep" / "report.html").read_text()
    assert main(["report", "run", "sweep/seed=0", "out=both.html"]) == 0
    assert "2 runs, 2 configurations" in (home / "both.html").read_text()


def test_damage_is_found_and_recovered(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    copy = home / "damaged"
    subprocess.run(["cp", "-r", home / "demos", copy], check=True)
    victim = next((copy / "demos").iterdir())
    victim.write_bytes(victim.read_bytes()[:-5000])
    assert main(["validate", str(copy), QUIET]) == 2
    assert "aerial-il recover" in capsys.readouterr().err
    assert main(["recover", str(copy)]) == 0
    assert main(["validate", str(copy), QUIET]) == 0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["train", "dataset=nowhere", "run=r"], "aerial-il collect"),
        (["train", "dataset=demos", "dataset.episodes=100", "run=r"], "dataset.episodes=100 asks for more"),
        (["evaluate", "policy=nowhere", "out=o"], "does not exist"),
        (["evaluate", "policy=expert", "out=o"], "robot=... and task=..."),
        (["evaluate", "policy=run", "task=pick_place", "out=o"], "task"),
        (["collect", "action=nonsense", "out=o"], "ee_pose"),
        (["collect", "cameras=[nonsense]", "out=o"], "scene"),
        (["validate", "nowhere"], "does not exist"),
        (["report", "nowhere"], "aerial-il evaluate"),
        (["train", "dataset=demos", "run=r", "evaluate_every=5", "evaluate_seed=9990"], "evaluate_seed=9990"),
        (["train", "dataset=demos", "run=r", "algorithm.patience=1"], "evaluate_every"),
        (["train", "dataset=demos", "run=r", "policy.chunk=5000"], "chunk=5000 must not be longer"),
        (["train", "dataset=demos", "run=r", "algorithm.selection.operators=[nobody]"], "nobody"),
    ],
)
def test_bad_input_is_answered(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 2
    assert said in capsys.readouterr().err
