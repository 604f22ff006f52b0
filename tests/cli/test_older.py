"""What an older engine, an older tier and older observations left behind is told apart, never silently taken as new."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from aerial_il import load_policy, open_dataset
from aerial_il.cli.main import main
from aerial_il.core import checkpoint
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import ObservationSpec
from aerial_il.data.provenance import engine_of
from aerial_il.suite import tiers
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.engine import ENGINE

QUIET = "progress=false"
SMALL = ["policy.hidden=[8]", "algorithm.steps=2", "algorithm.validate_every=0", "algorithm.cadence.log_every=1"]
COLLECT = ["collect", "robot=quad", "task=hover", "tier=gusts", "episodes=2", QUIET]
EVALUATE = ["evaluate", "policy=run", "tier=gusts", "episodes=1", "videos=0", QUIET]


@pytest.fixture(scope="module")
def older(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a dataset, a run and a result of before, when gusts had no noise and nothing named its engine."""
    home, today = tmp_path_factory.mktemp("older"), tiers.get
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(home)
        patch.setattr(BatchEnvironment, "engine", None)
        patch.setattr(tiers, "get", lambda name: before(today(name)))
        assert main([*COLLECT, "out=demos"]) == 0
        assert main(["train", "dataset=demos", "run=run", *SMALL, QUIET]) == 0
        assert main([*EVALUATE, "out=judged"]) == 0
    return home


def before(tier: tiers.Tier) -> tiers.Tier:
    return replace(tier, parts={name: part for name, part in tier.parts.items() if name != "noise"})


@pytest.fixture(autouse=True)
def at_home(older: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(older)


def test_a_recording_of_another_engine_is_not_replayed(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["replay", "demos"], ["validate", "demos", "replay=true"]):
        assert main([*words, QUIET]) == 2
        assert f"another version of the engine. expected {ENGINE}, got 1." in capsys.readouterr().err


def test_it_is_still_read_converted_and_described(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", "demos", QUIET]) == 0
    assert main(["convert", "demos", "out=converted", QUIET]) == 0
    assert main(["info", "demos", "--json"]) == 0
    told = capsys.readouterr().out
    assert {kind["engine"] for kind in json.loads(told[told.index("{") :])["made_by"]} == {"1"}
    assert {engine_of(episode.provenance) for episode in open_dataset("converted")} == {"1"}


def test_training_on_it_is_told_what_has_changed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "dataset=demos", "run=again", *SMALL, QUIET]) == 0
    said = capsys.readouterr().err
    assert 'Tier gusts has changed its meaning since: noise was absent, is {"scale": 1.0' in said
    assert f"version 1 of the engine, today's is {ENGINE}" in said


def test_a_policy_of_an_older_tier_is_told_when_it_is_judged(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*EVALUATE, "out=today"]) == 0
    assert "run: Tier gusts has changed its meaning since: noise was absent" in capsys.readouterr().err
    assert json.loads(Path("today/evaluation.json").read_text())["provenance"]["engine"] == ENGINE


def test_results_of_other_meaning_are_compared_with_a_warning(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*EVALUATE, "out=new"]) == 0
    capsys.readouterr()
    assert main(["compare", "judged", "new"]) == 0
    said = capsys.readouterr().err
    assert "Tier gusts did not mean the same in both: noise was absent" in said
    assert f"a was flown with version 1 of the engine, b with {ENGINE}" in said


def test_a_result_of_before_is_not_taken_for_one_of_today(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*EVALUATE, "out=judged"]) == 2
    assert "engine None != 2" in capsys.readouterr().err.replace(ENGINE, "2")


def test_a_dataset_of_before_takes_no_flights_of_today(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*COLLECT, "seed=7", "out=demos"]) == 2
    said = capsys.readouterr().err
    assert "disturbances" in said
    assert f"engine 1 != {ENGINE}" in said


def test_what_is_made_today_is_of_today(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*COLLECT, "out=fresh"]) == 0
    capsys.readouterr()
    assert main(["train", "dataset=fresh", "run=fresh_run", *SMALL, QUIET]) == 0
    assert "Warning" not in capsys.readouterr().err
    assert main(["replay", "fresh", QUIET]) == 0
    assert main(["convert", "fresh", "out=derived", QUIET]) == 0
    assert {engine_of(episode.provenance) for episode in open_dataset("derived")} == {ENGINE}


def test_a_policy_of_older_fields_is_refused_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    saved = checkpoint.load(Path("run/policy"))
    config = json.loads(json.dumps(saved.config))
    next(f for f in config["spec"]["observation"]["fields"] if f["name"] == "base_vel")["name"] = "base_vel_body"
    checkpoint.save(tmp_path / "old", replace(saved, config=config))
    assert main([*EVALUATE, f"policy={tmp_path / 'old'}", "out=no"]) == 2
    assert "observation.fields.base_vel_body.shape: [3] != None" in capsys.readouterr().err
    assert not Path("no").exists()


def test_a_policy_of_other_shapes_is_refused_by_them() -> None:
    policy = load_policy("run")
    fields = tuple(
        replace(f, shape=(4,), labels=()) if f.name == "base_vel" else f for f in policy.spec.observation.fields
    )
    with pytest.raises(InvalidValueError, match=r"base_vel.shape: \[3\] != \[4\]"):
        policy.check(replace(policy.spec, observation=ObservationSpec(fields)))
