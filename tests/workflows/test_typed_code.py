"""A user's own pilot flies, records and is judged from the command line; only what was typed names code."""

import importlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il.cli.main import main
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.recording.reader import read_episode
from aerial_il.workflows.parts.typed_code import names_code, policy_of

PILOTS = '''
import numpy as np

class Still:
    """A policy with everything that one may have."""
    def act(self, obs):
        n = len(obs["target_pos"])
        return np.concatenate([obs["target_pos"], np.tile([1.0, 0, 0, 0, 1.0, 0], (n, 1))], axis=1)
    def reset(self, mask=None):
        pass

def make_function():
    return Still().act

def make_nothing():
    return 7

def fail():
    raise RuntimeError("the servo is off")
'''
QUIET = "progress=false"


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    (tmp_path / "my_pilots.py").write_text(PILOTS)
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    sys.modules.pop("my_pilots", None)


def test_a_pilot_of_one_s_own_is_judged(home: Path) -> None:
    where = ["robot=quad", "task=hover", "episodes=2", "videos=0", QUIET]
    assert main(["evaluate", "policy=my_pilots:Still", *where, "out=judged"]) == 0
    assert main(["evaluate", "policy=my_pilots:make_function", *where, "out=function"]) == 0
    one, other = (json.loads(Path(out, "evaluation.json").read_text()) for out in ("judged", "function"))
    assert one["policy"] == "my_pilots:Still"
    assert one["success"] == other["success"]
    assert "policy=my_pilots:Still" in one["provenance"]["command"]
    assert str(home) not in sys.path
    assert len({each["provenance"]["policy_sha256"] for each in (one, other)}) == 2, "two factories of one module"


def test_a_result_that_names_code_does_not_run_it(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    where = ["robot=quad", "task=hover", "episodes=2", "videos=0", QUIET]
    assert main(["evaluate", "policy=my_pilots:Still", *where, "out=judged"]) == 0
    again = ["evaluate", "again=judged", "videos=0", QUIET]
    (home / "my_pilots.py").write_text(PILOTS + "\nopen('ran', 'w').close()\n")
    sys.modules.pop("my_pilots")
    assert main([*again, "out=again"]) == 2
    assert "files do not decide what runs" in (said := capsys.readouterr().err)
    assert "type it too: policy=my_pilots:Still" in said
    assert not (home / "ran").exists()
    assert main([*again, "policy=my_pilots:make_function", "out=again"]) == 2
    assert "flown with policy=my_pilots:Still, not with policy=my_pilots:make_function" in capsys.readouterr().err
    assert main([*again, "policy=my_pilots:Still", "out=again"]) == 0
    assert "2 of 2 flights are equal" in capsys.readouterr().out
    assert (home / "ran").exists()


def test_code_that_was_changed_is_another_pilot(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    where = ["robot=quad", "task=hover", "episodes=1", QUIET]
    judged, recorded = (
        ["evaluate", "policy=my_pilots:Still", *where, "videos=0", "out=judged"],
        ["collect", "expert=my_pilots:Still", *where, "out=mine"],
    )
    for words in (judged, recorded):
        assert main(words) == 0
    Path("judged/videos").mkdir()
    Path("judged/videos/seed_10000_timeout.mp4").write_bytes(b"of before")
    del sys.modules["my_pilots"]
    (home / "my_pilots.py").write_text(PILOTS.replace("[1.0, 0, 0", "[0.0, 1.0, 0"))
    importlib.invalidate_caches()
    capsys.readouterr()
    for words in (judged, [*recorded, "seed=1"]):
        assert main(words) == 2
        assert "policy_sha256" in (said := capsys.readouterr().err) or "another evaluation" in said
    assert main([*judged, "overwrite=true"]) == 0
    assert not [*Path("judged").glob("videos/*")], "films show the result that they lie beside"


def test_it_flies_in_environments_from_outside_too(home: Path) -> None:
    Path("cart.py").write_text(
        "def make():\n    return lambda obs: __import__('numpy').zeros((len(obs['observation']), 1))\n"
    )
    where = ["env=gymnasium:Pendulum-v1", "max_steps=5", "success=survived", "episodes=2", QUIET]
    assert main(["collect", "policy=cart:make", *where, "out=demos"]) == 0
    assert not aerial_il.open_dataset("demos")[0].actions.any()


def test_demonstrations_are_recorded_by_an_expert_of_one_s_own(home: Path) -> None:
    where = ["robot=quad", "task=hover", "episodes=1", QUIET]
    assert main(["collect", "expert=my_pilots:Still", *where, "out=mine"]) == 0
    assert main(["collect", "expert=scripted", *where, "out=ours"]) == 0
    (episode,) = open_dataset("mine", failures=True)
    assert episode.provenance["policy"] == "my_pilots:Still"
    np.testing.assert_allclose(episode.actions[0][:3], episode.obs["target_pos"][0])


ROUNDS = ["rounds=1", "episodes=2", "between_steps=2", "training.steps=2", "training.cadence.log_every=1"]


@pytest.mark.slow
def test_who_learns_in_rounds_asks_an_expert_of_one_s_own(home: Path) -> None:
    where = ["robot=quad", "task=hover", "episodes=2", QUIET]
    assert main(["collect", "expert.noise=0", *where, "out=demos"]) == 0
    small = ["policy.hidden=[8]", "policy.chunk=1", "policy.ensemble=null"]
    flights = [*(f"algorithm.{setting}" for setting in ROUNDS), "threads=1", QUIET]
    learn = ["train", "algorithm=dagger", "dataset=demos", *small, *flights, "expert=my_pilots:Still"]
    assert main([*learn, "run=asked"]) == 0
    flown = [read_episode(file) for file in Path("asked/rounds").rglob("*.mcap")]
    labels = np.concatenate([episode.expert_actions for episode in flown])
    asked = np.isfinite(labels).all(axis=1)
    targets = np.concatenate([episode.obs["target_pos"][:-1] for episode in flown])
    assert asked.any()
    np.testing.assert_allclose(labels[asked, :3], targets[asked], atol=1e-6)
    assert "expert=my_pilots:Still" in json.loads(Path("asked/command.json").read_text())["command"]
    del sys.modules["my_pilots"]
    assert main(["report", "asked"]) == 0
    assert main(["runs", ".", "page=true"]) == 0
    assert "my_pilots" not in sys.modules, "what a run's folder says names no code"


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ("nowhere_at_all:make", "No module named 'nowhere_at_all'"),
        ("my_pilots:gone", "has no attribute 'gone'"),
        ("my_pilots:make_nothing", "makes a int: neither a policy nor a function"),
        ("my_pilots:fail", "RuntimeError: the servo is off"),
        ("my_pilots", "write module:factory"),
        ("../my_pilots:Still", "write module:factory"),
    ],
)
def test_what_cannot_be_made_is_answered(home: Path, typed: str, said: str) -> None:
    with pytest.raises(InvalidValueError, match=said):
        policy_of(typed)
    if names_code(typed):
        assert main(["evaluate", f"policy={typed}", "robot=quad", "task=hover", "out=judged"]) == 2


def test_a_folder_of_that_name_is_a_folder(home: Path) -> None:
    assert names_code("my_pilots:Still")
    (home / "my_pilots:Still").mkdir()
    assert not names_code("my_pilots:Still")


def test_it_says_what_is_missing(home: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "policy=my_pilots:Still", "out=judged"]) == 2
    assert "needs robot=... and task=..., or env=..." in capsys.readouterr().err
