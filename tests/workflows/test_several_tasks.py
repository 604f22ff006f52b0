"""A folder of several tasks: learned from evenly, flown on the way and filmed in each of them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from aerial_il.cli.main import main
from aerial_il.core.errors import InvalidValueError
from aerial_il.evaluation.training_run import read_run
from aerial_il.workflows.parts import demonstrations, run_results

QUIET = "progress=false"
TASKS = ("press_button", "reach")


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with demonstrations of two tasks, and one that holds the same task twice."""
    folder = tmp_path_factory.mktemp("tasks")
    for task in TASKS:
        assert main(["collect", f"task={task}", "episodes=2", f"out={folder / 'both' / task}", QUIET]) == 0
    more = ["task=reach", "seed=2", "episodes=1", f"out={folder / 'reach' / 'b'}"]
    shutil.copytree(folder / "both" / "reach", folder / "reach" / "a")
    assert main(["collect", *more, QUIET]) == 0
    return folder


@pytest.fixture(scope="module")
def run(home: Path) -> Path:
    """A policy for both tasks, flown while it learned."""
    words = ["dataset.episodes=2", "policy.hidden=[8]", "algorithm.steps=2", "evaluate_every=2", "evaluate_episodes=3"]
    assert main(["train", f"dataset={home / 'both'}", *words, f"run={home / 'run'}", QUIET]) == 0
    return home / "run"


def test_it_is_flown_in_each_of_its_tasks_while_it_learns(run: Path) -> None:
    rows = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    flown = [row for row in rows if "evaluate/success" in row]
    (row,) = flown
    each = [row[f"evaluate/success/{task}"] for task in TASKS]
    assert row["evaluate/success"] == pytest.approx(sum(each) / 2)
    assert row["evaluate/episodes"] == 4, "three flights are shared among two tasks, rounded up"


@pytest.mark.render
@pytest.mark.slow
def test_its_report_shows_a_flight_of_each_of_its_tasks(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_results, "FLOWN", 1)
    footage = run_results.footage(read_run(run), 1)
    assert (footage.note, [clip.path.parent.name for clip in footage.clips]) == ("", list(TASKS))
    assert all(clip.path.stat().st_size for clip in footage.clips)


def test_a_few_demonstrations_are_taken_evenly_from_all_tasks(home: Path) -> None:
    chosen = list(demonstrations.open_demonstrations(str(home / "both"), limit=4))
    assert [episode.spec.task for episode in chosen] == [*TASKS, *TASKS]
    assert [episode.provenance["seed"] for episode in chosen] == [0, 0, 1, 1]
    with pytest.raises(InvalidValueError, match="has 4 successful demonstrations"):
        demonstrations.open_demonstrations(str(home / "both"), limit=5)


def test_folders_of_one_task_are_taken_one_after_the_other(home: Path) -> None:
    chosen = list(demonstrations.open_demonstrations(str(home / "reach"), limit=3))
    assert [episode.provenance["seed"] for episode in chosen] == [0, 1, 2]
