"""A sweep is evaluated as a whole: each run in a folder of its own, and all in one ranking."""

import shutil
from pathlib import Path

import pytest

from aerial_il.cli.main import main

ENV = ["env=gymnasium:CartPole-v1", "success=survived", "max_steps=5"]
QUIET = ["threads=1", "progress=false"]
SMALL = [
    "policy.hidden=[8]",
    "policy.chunk=1",
    "policy.ensemble=null",
    "algorithm.steps=2",
    "algorithm.validate_every=0",
]


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> Path:
    home = tmp_path_factory.mktemp("swept")
    assert main(["collect", *ENV, "policy=random", "episodes=2", f"out={home / 'demos'}", *QUIET]) == 0
    for seed, name in enumerate(("one", "two")):
        words = [f"dataset={home / 'demos'}", f"run={home / 'sweep' / name}", f"seed={seed}"]
        assert main(["train", *words, *SMALL, *QUIET]) == 0
    return home / "sweep"


def test_the_runs_of_a_sweep_are_ranked(sweep: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["evaluate", f"policy={sweep}", f"out={tmp_path}", "episodes=2", "videos=0", *ENV, *QUIET]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert (tmp_path / "one" / "evaluation.json").exists()
    assert (tmp_path / "two" / "evaluation.json").exists()
    assert said.index("rank") < said.rindex(str(tmp_path / "one"))
    assert "Holm" in said


def test_a_sweep_that_is_not_finished_is_named(
    sweep: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(sweep, tmp_path / "half")
    shutil.rmtree(tmp_path / "half" / "two" / "policy")
    assert main(["evaluate", f"policy={tmp_path / 'half'}", f"out={tmp_path / 'out'}", *ENV, *QUIET]) == 2
    assert "two did not finish" in capsys.readouterr().err


def test_a_sweep_of_evaluations_ends_with_a_ranking(
    sweep: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    policies = f"policy={sweep / 'one'},{sweep / 'two'}"
    assert main(["evaluate", "-m", policies, f"out={tmp_path}", "episodes=2", "videos=0", *ENV, *QUIET]) == 0
    assert "Holm" in capfd.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["evaluate", "policy=random", "robot=quad", "task=hover"], "leave out robot=quad task=hover"),
        (["evaluate", "policy=random", "tier=gusts"], "tier=gusts is for the suite"),
        (["evaluate", "policy=random", "controller=pid"], "controller=pid is for the suite"),
        (["evaluate", "policy=expert", "robot=quad", "task=hover"], "has no expert of its own"),
        (["collect", "policy=random", "robot=quad", "tier=gusts"], "robot=quad tier=gusts is for the suite"),
        (["collect", "policy=random", "cameras=[wrist]"], "cameras=('wrist',) is for the suite"),
        (["collect", "policy=random", "expert.look=true"], "expert.look=True is for the suite"),
        (["collect", "policy=random", "expert.noise=0.1"], "expert.noise=0.1 is for the suite"),
    ],
)
def test_what_an_environment_from_outside_would_ignore_is_refused(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*words, *ENV, "episodes=1", f"out={tmp_path / 'out'}", *QUIET]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
