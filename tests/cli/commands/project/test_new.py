"""What ``aerial-il new`` writes is what the pages explain; it is found, it runs, and nothing is overwritten."""

from pathlib import Path

import pytest

from aerial_il import policies, robots
from aerial_il.algorithms.bc import BC
from aerial_il.cli.main import main
from aerial_il.suite import tasks
from aerial_il.workflows import new, starts
from tests.algorithms import drift
from tests.cli.next_lines import next_commands
from tests.contract import test_algorithms
from tests.contract.test_feasibility import solved
from tests.project.test_examples import files, found_beside_ours

SHOWN = {"task": "touch_point", "robot": "two_joint_hexa", "policy": "linear", "algorithm": "sac_prior"}


@pytest.mark.parametrize("kind", SHOWN)
def test_the_pages_explain_what_is_written(kind: str) -> None:
    for path, text in starts.start(kind, SHOWN[kind]).items():
        assert text == files()[path], path


def written(kind: str, name: str, top: Path) -> None:
    assert main(["new", kind, name, f"into={top}"]) == 0


def test_a_policy_learns_at_once(tmp_path: Path) -> None:
    written("policy", "my_network", tmp_path)
    with found_beside_ours(tmp_path):
        assert "my_network" in policies.names()
        policy = policies.get("my_network")(chunk=1, ensemble=None, anchor=None)
        settings = BC(steps=20, batch_size=64, warmup_steps=1, validation=0.0)
        learned = settings.train(drift.demonstrations(5), policy, run=tmp_path / "run", progress=False)
        assert learned.origin["step"] == 20


def test_an_algorithm_fulfils_its_contract(tmp_path: Path) -> None:
    written("algorithm", "my_learner", tmp_path)
    with found_beside_ours(tmp_path):
        test_algorithms.test_it_fulfils_the_contract("my_learner")
        test_algorithms.test_impossible_settings_are_refused("my_learner")


def test_a_robot_is_found(tmp_path: Path) -> None:
    written("robot", "my_hexa", tmp_path)
    with found_beside_ours(tmp_path):
        assert robots.get("my_hexa").name == "my_hexa"
        assert ("my_hexa", "reach") in tasks.cells()


@pytest.mark.slow
def test_a_robot_and_a_task_are_flown(tmp_path: Path) -> None:
    written("robot", "my_hexa", tmp_path)
    written("task", "my_point", tmp_path)
    with found_beside_ours(tmp_path):
        assert solved("my_hexa", "reach") == 4
        assert solved("fa_hexa_arm4", "my_point") == 4


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["task", "reach"], "A task named reach already exists"),
        (["policy", "mlp_local"], "A policy named mlp_local already exists"),
        (["task", "../escape"], "cannot be the name"),
        (["task", "class"], "cannot be the name"),
        (["gadget", "x"], "kind='gadget' is not one of task, robot, "),
    ],
)
def test_a_bad_name_is_refused(words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["new", *words, f"into={tmp_path}"]) == 2
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_what_is_there_is_left_as_it_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written("policy", "my_network", tmp_path)
    file = tmp_path / "aerial_il/policies/my_network.py"
    file.write_text("mine")
    assert main(["new", "policy", "my_network", f"into={tmp_path}"]) == 2
    assert "already exists" in capsys.readouterr().err
    assert file.read_text() == "mine"


def test_an_installed_package_is_not_written_into(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(new, "__file__", str(tmp_path / "site-packages/aerial_il/workflows/new.py"))
    assert main(["new", "policy", "my_network"]) == 2
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("kind", "like"), [("task", "reach"), ("robot", "quad"), ("policy", "mlp"), ("algorithm", "sac")]
)
def test_what_comes_next_is_a_command(kind: str, like: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With one of ours in place of the new one, whose settings are read where our package lies."""
    written(kind, "my_own", tmp_path)
    assert len(next_commands(capsys.readouterr().out.replace("my_own", like))) == 1
