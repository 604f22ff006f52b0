"""A killed evaluation continues with what it had, and no result is written where it does not belong."""

import json
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aerial_il.cli.main import main
from aerial_il.core.errors import InvalidValueError
from aerial_il.evaluation.destination import CALLED, finished, subject_of
from aerial_il.evaluation.journal import NOTE, Journal
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.rollouts import evaluate
from tests.data.crane import CraneBatch, CraneExpert

pytestmark = pytest.mark.usefixtures("no_commit")
SEEDS = range(100, 112)
QUIET = "progress=false"
CART = ["policy=random", "env=gymnasium:CartPole-v1", "success=survived", "threads=1", "videos=0", QUIET]
KILLED = """
import os, signal, sys
from aerial_il.cli.main import main
replace, kept = os.replace, []

def die_at_the_ninth(source, target):
    if str(target).endswith(".npz"):
        if len(kept) == 8:
            os.kill(os.getpid(), signal.SIGKILL)
        kept.append(target)
    replace(source, target)

os.replace = die_at_the_ninth
sys.exit(main(sys.argv[1:]))
"""


class Killed(Exception):
    """What ends a flight in a test."""


class Mortal(Journal):
    """A journal whose process dies after so many flights."""

    def __init__(self, out: Path, flights: int) -> None:
        super().__init__(out)
        self.left = flights

    def keep(self, kept: Any) -> None:
        super().keep(kept)
        self.left -= 1
        if not self.left:
            raise Killed


def fly(journal: Journal | None, worlds: int = 4, seeds: Any = SEEDS) -> EvaluationResult:
    return evaluate(
        CraneBatch(worlds), CraneExpert(dive=True), seeds, policy_name="diver", journal=journal, progress=False
    )


def content(result: EvaluationResult) -> dict[str, Any]:
    content = result.to_dict()
    content["provenance"] = {k: v for k, v in content["provenance"].items() if k != "wall_time_s"}
    return content


@pytest.mark.parametrize("flights", [1, 5, 12])
def test_flights_before_a_kill_are_kept_to_the_same_result(tmp_path: Path, flights: int) -> None:
    whole = fly(None)
    with pytest.raises(Killed):
        fly(Mortal(tmp_path, flights))
    kept = Journal(tmp_path).read(SEEDS)
    assert len(kept) == flights
    counted = Mortal(tmp_path, 99)
    result = fly(counted)
    assert counted.left == 99 - (len(SEEDS) - flights), "finished flights are not flown again"
    assert content(result) == content(whole)
    for seed in SEEDS:
        one, other = result.flights[seed], whole.flights[seed]
        np.testing.assert_array_equal(one.actions, other.actions)
        np.testing.assert_array_equal(one.ee_path, other.ee_path)
        np.testing.assert_array_equal(one.phase, other.phase)
        assert one.phase_names == other.phase_names


def test_a_damaged_flight_is_flown_anew(tmp_path: Path) -> None:
    with pytest.raises(Killed):
        fly(Mortal(tmp_path, 3))
    victim = min(Journal(tmp_path).path.glob("*.npz"))
    victim.write_bytes(victim.read_bytes()[:-50])
    assert content(fly(Journal(tmp_path))) == content(fly(None))


def subject(**changed: Any) -> dict[str, Any]:
    environment = {
        "action_level": "ee_pose",
        "controller": "pid",
        "max_steps": 9,
        "disturbances": {"wind": {"share": 1}},
    }
    provenance = {"engine": "3", "packages": {}, "git": {"sha": "a"}, "policy_sha256": None, "environment": environment}
    about = {"robot": "r", "task": "t", "tier": "calm", "policy": "p", "seeds": range(3), "provenance": provenance}
    for name, value in changed.items():
        place = next(tree for tree in (about, provenance, environment) if name in tree)
        place[name] = value
    return subject_of(**about)


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"policy": "q"}, "policy p != q"),
        ({"policy_sha256": "ab"}, "policy p != ab"),
        ({"tier": "gusts"}, "tier calm != gusts"),
        ({"seeds": range(1, 4)}, "seeds 0 to 2 != 1 to 3"),
        ({"seeds": range(4)}, "seeds 0 to 2 != 0 to 3"),
        ({"controller": "lqr"}, "controller pid != lqr"),
        ({"max_steps": 8}, "max_steps 9 != 8"),
        ({"disturbances": {"wind": {"share": 2}}}, 'disturbances {"wind": {"share": 1}} != {"wind": {"share": 2}}'),
        ({"engine": "9"}, "engine 3 != 9"),
        ({"git": {"sha": "b"}}, 'git {"sha": "a"} != {"sha": "b"}'),
    ],
)
def test_flights_of_something_else_are_refused_by_name(tmp_path: Path, changed: dict[str, Any], named: str) -> None:
    journal = Journal(tmp_path)
    journal.start(subject())
    fly_into(journal)
    assert finished(tmp_path, subject(), overwrite=False) is None
    with pytest.raises(InvalidValueError, match="overwrite=true") as caught:
        finished(tmp_path, subject(**changed), overwrite=False)
    assert named in str(caught.value)
    assert journal.path.exists()
    assert finished(tmp_path, subject(**changed), overwrite=True) is None
    assert not journal.path.exists()


@pytest.mark.parametrize(
    ("before", "now", "named"),
    [
        ("runs/a", "runs/b", "policy runs/a != runs/b "),
        ("runs/a", "runs/a", "policy runs/a as it was then != runs/a as it is now, with other weights "),
    ],
)
def test_weights_are_named_by_their_place_not_their_digest(tmp_path: Path, before: str, now: str, named: str) -> None:
    journal = Journal(tmp_path)
    journal.start({**subject(policy_sha256="ab" * 32), CALLED: before})
    fly_into(journal)
    with pytest.raises(InvalidValueError) as caught:
        finished(tmp_path, subject(policy_sha256="cd" * 32), called=now, overwrite=False)
    assert named in str(caught.value)
    assert "abab" not in str(caught.value)
    assert "cdcd" not in str(caught.value)


@pytest.mark.parametrize("damaged", ["[]", "5", '"x"', "null", "{"])
def test_a_note_that_is_none_is_no_subject(tmp_path: Path, damaged: str) -> None:
    journal = Journal(tmp_path)
    journal.path.mkdir()
    (journal.path / NOTE).write_text(damaged)
    assert journal.subject() is None
    assert finished(tmp_path, subject(), overwrite=False) is None


def fly_into(journal: Journal) -> None:
    fly(journal, worlds=1, seeds=[100])


def test_weights_are_the_policy_whatever_the_folder_is_called() -> None:
    assert subject(policy_sha256="ab") == subject(policy_sha256="ab", policy="q")


def test_a_result_of_something_else_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["evaluate", *CART, "episodes=3", "out=judged"]
    assert main([*words, "max_steps=9"]) == 0
    assert not (tmp_path / "judged" / "flights").exists()
    before = (tmp_path / "judged" / "evaluation.json").read_bytes()
    assert main([*words, "max_steps=9"]) == 0
    assert "nothing is flown" in capsys.readouterr().out
    for other in (["max_steps=8"], ["max_steps=9", "seed=5"], ["max_steps=9", "episodes=4"]):
        assert main([*words, *other]) == 2
        assert "overwrite=true" in capsys.readouterr().err
    assert (tmp_path / "judged" / "evaluation.json").read_bytes() == before
    assert main([*words, "max_steps=8", "overwrite=true"]) == 0
    assert json.loads((tmp_path / "judged" / "evaluation.json").read_text()) != json.loads(before)
    (tmp_path / "judged" / "evaluation.json").write_bytes(before[: len(before) // 2])
    assert main([*words, "max_steps=9"]) == 2
    assert "overwrite=true" in capsys.readouterr().err
    assert main([*words, "max_steps=9", "overwrite=true"]) == 0, "what was advised is possible"


@pytest.mark.parametrize("place", ["demos", "demos/inside", "demos/demos"])
def test_nothing_is_written_into_a_dataset(
    place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    flown = ["env=gymnasium:CartPole-v1", "policy=random", "success=survived", "max_steps=3", "episodes=1"]
    assert main(["collect", *flown, "out=demos", QUIET]) == 0
    before = sorted((tmp_path / "demos").rglob("*"))
    for words in ([], ["overwrite=true"]):
        assert main(["evaluate", *CART, "max_steps=9", "episodes=1", f"out={place}", *words]) == 2
        assert "into the dataset" in capsys.readouterr().err
    assert sorted((tmp_path / "demos").rglob("*")) == before


def test_a_real_kill_loses_no_finished_flight(tmp_path: Path) -> None:
    words = ["evaluate", *CART, "num_envs=1", "max_steps=400", "episodes=60"]
    killed = subprocess.run([sys.executable, "-c", KILLED, *words, f"out={tmp_path / 'killed'}"], check=False)
    assert killed.returncode == -signal.SIGKILL
    assert len(list((tmp_path / "killed" / "flights").glob("[0-9]*.npz"))) == 8
    again = shutil.copytree(tmp_path / "killed", tmp_path / "copy")
    assert main([*words, f"out={again}"]) == 0
    assert main([*words, f"out={tmp_path / 'whole'}"]) == 0
    one, other = (json.loads((tmp_path / n / "evaluation.json").read_text()) for n in ("copy", "whole"))
    for result in (one, other):
        del result["provenance"]["wall_time_s"], result["provenance"]["command"]
    assert one == other
