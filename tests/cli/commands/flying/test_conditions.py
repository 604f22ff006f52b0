"""``evaluate conditions=[...]`` and ``again=``: one table and one page, and the same flights once more."""

import json
from pathlib import Path

import pytest

from aerial_il.cli.main import main
from aerial_il.evaluation.result import load_result

EXPERT = ["policy=expert", "robot=ua_quad_arm4", "task=reach", "episodes=3", "videos=0", "progress=false"]


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("laboratory") / "out"
    assert main(["evaluate", *EXPERT, "conditions=[wind=2,latency=3,gusts]", f"out={out}"]) == 0
    return out


def test_every_condition_is_flown_over_the_same_seeds(flown: Path) -> None:
    tiers = {"calm": "calm", "wind-2": "calm+wind:2", "latency-3": "calm+latency:3", "gusts": "gusts"}
    results = {name: load_result(flown / name) for name in tiers}
    assert {name: result.tier for name, result in results.items()} == tiers
    assert all(result.seeds == results["calm"].seeds for result in results.values())
    found = json.loads((flown / "conditions.json").read_text())
    assert [row["condition"] for row in found["rows"]] == ["calm", "wind=2", "latency=3", "gusts"]
    assert found["command"].startswith("aerial-il evaluate")


def test_the_page_says_what_each_costs_and_where_it_starts(flown: Path) -> None:
    page = (flown / "conditions.html").read_text()
    for said in ("wind=2", "latency=3", "target pos at the start, from above", "Get this page again"):
        assert said in page
    assert "Performance profile" not in page, "one training has none, under however many conditions"
    assert "http" not in page.replace("http://www.w3.org", ""), "it opens offline"


def test_asked_once_more_nothing_is_flown(flown: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {file: file.stat().st_mtime_ns for file in flown.rglob("evaluation.json")}
    assert main(["evaluate", *EXPERT, "conditions=[wind=2,latency=3,gusts]", f"out={flown}"]) == 0
    assert before == {file: file.stat().st_mtime_ns for file in flown.rglob("evaluation.json")}
    assert "Holm" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["conditions=[wind=7]"], "wind:7 is not possible: its strength is a number from 0 to 3"),
        (["conditions=[wnd=1]"], "Did you mean 'wind'"),
        (["conditions=[storm]"], "Unknown tier 'storm'"),
        (["conditions=[wind=2,wind=2.0]"], "conditions=wind=2.0 is wind=2 again"),
        (["conditions=[camera_shift=0.02]"], "expert looks through no camera"),
        (["conditions=[calm+camera_shift]"], "expert looks through no camera"),
        (["robot=floating_gripper", "conditions=[wind=1]"], "feels no wind"),
        (["robot=z1", "conditions=[motors=0.9]"], "has no rotors"),
    ],
)
def test_conditions_that_cannot_be_are_refused(
    words: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["evaluate", *EXPERT, *words, f"out={tmp_path / 'out'}"]) == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_an_evaluation_is_repeated_flight_by_flight(
    flown: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again = [f"again={flown / 'wind-2'}", f"out={tmp_path / 'again'}", "videos=0", "progress=false"]
    assert main(["evaluate", *again, "num_envs=2"]) == 0
    assert "3 of 3 flights are equal in all their numbers" in capsys.readouterr().out
    assert main(["evaluate", *again, "seed=5"]) == 2
    assert "leave out seed=5" in capsys.readouterr().err
    for place in (flown / "wind-2", flown / "wind-2" / "evaluation.json"):
        assert main(["evaluate", f"again={place}", f"out={flown / 'wind-2'}", "overwrite=true"]) == 2
        assert "holds the evaluation that is to be repeated" in capsys.readouterr().err
    assert main(["evaluate", f"again={tmp_path}", f"out={tmp_path / 'other'}"]) == 2
    assert main(["evaluate", *again, "num_envs=2"]) == 2, "the folder holds that very result: nothing would be flown"
    assert "nothing was flown" in capsys.readouterr().err


def test_flights_that_somebody_left_out_are_missed(
    flown: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    raw = json.loads((flown / "calm" / "evaluation.json").read_text())
    left_out = raw["per_episode"].pop(0)
    raw["episodes"] -= 1
    raw["success"]["count"] -= left_out["success"]
    (tmp_path / "claimed").mkdir()
    (tmp_path / "claimed" / "evaluation.json").write_text(json.dumps(raw))
    words = [f"again={tmp_path / 'claimed'}", f"out={tmp_path / 'again'}", "videos=0", "progress=false"]
    assert main(["evaluate", *words]) == 0
    said = capsys.readouterr().out
    assert f"1 stand on one side alone, seed {left_out['seed']} first" in said
    assert "2 of 3 flights are equal" in said


def test_flights_that_ended_otherwise_are_named(
    flown: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Somebody's figures are not ours: a result whose numbers were changed is found out."""
    raw = json.loads((flown / "calm" / "evaluation.json").read_text())
    raw["per_episode"][1]["return"] += 1.0
    (tmp_path / "claimed").mkdir()
    (tmp_path / "claimed" / "evaluation.json").write_text(json.dumps(raw))
    words = [f"again={tmp_path / 'claimed'}", f"out={tmp_path / 'again'}", "videos=0", "progress=false"]
    assert main(["evaluate", *words]) == 0
    said = capsys.readouterr().out
    assert "2 of 3 flights are equal" in said
    assert f"Seeds that differ: {raw['per_episode'][1]['seed']}." in said
