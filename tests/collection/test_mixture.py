"""A dataset stays of one kind unless somebody wants it mixed, and says what it is made of."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from aerial_il.cli.main import main
from aerial_il.collection.collect import collect
from aerial_il.core.errors import InvalidValueError
from tests.data.crane import CraneBatch, CraneExpert

QUIET = "progress=false"
REACH = ["collect", "robot=quad", "task=hover", "episodes=2", "seed=3", QUIET]


def fly(out: Path, seeds: Any, **changed: Any) -> Any:
    told = {"policy_name": "expert", "settings": {"noise": 0.0}, "progress": False}
    return collect(CraneBatch(2), CraneExpert(), seeds, out, **(told | changed))


def test_other_seeds_of_the_same_kind_are_added(tmp_path: Path) -> None:
    fly(tmp_path, range(2))
    assert len(fly(tmp_path, range(1, 4)).skipped) == 1
    assert len(list(tmp_path.rglob("*.mcap"))) == 4


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"settings": {"noise": 0.3}}, "settings {'noise': 0.0} != {'noise': 0.3}"),
        ({"policy_name": "a"}, "expert != a"),
    ],
)
def test_another_kind_is_refused_by_name_unless_it_is_wanted(
    tmp_path: Path, changed: dict[str, Any], named: str
) -> None:
    fly(tmp_path, range(2))
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InvalidValueError, match="mix=true") as caught:
        fly(tmp_path, range(2, 4), **changed)
    assert named in str(caught.value)
    assert sorted(tmp_path.rglob("*")) == before
    fly(tmp_path, range(2), mix=True, **changed)
    fly(tmp_path, range(5, 6), **changed)  # both kinds are at home now
    fly(tmp_path, range(6, 7))


def test_another_engine_is_another_kind(tmp_path: Path) -> None:
    class Newer(CraneBatch):
        engine = "2"

    fly(tmp_path, range(2))
    with pytest.raises(InvalidValueError, match=r"engine 1 != 2"):
        collect(Newer(2), CraneExpert(), [7], tmp_path, settings={"noise": 0.0}, progress=False)


@pytest.fixture(scope="module")
def calm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("calm") / "demos"
    assert main([*REACH, f"out={out}"]) == 0
    return out


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["tier=gusts"], "tier calm != gusts"),
        (["expert.noise=0.2"], "'noise': 0.2"),
        (["controller=pid"], "controller geometric_observer != pid"),
        (["action=velocity"], "another environment"),
        (["robot=fa_hexa_arm4", "task=reach"], "another environment"),
        (["robot=fa_hexa_arm4", "task=reach", "mix=true"], "another environment"),
    ],
)
def test_the_command_refuses_to_mix(
    calm: Path, words: list[str], named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(calm.rglob("*"))
    assert main([*REACH, *words, f"out={calm}"]) == 2
    assert named in capsys.readouterr().err
    assert sorted(calm.rglob("*.mcap")) == sorted(file for file in before if file.suffix == ".mcap")


def test_info_counts_what_was_mixed(calm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mixed = shutil.copytree(calm, tmp_path / "mixed")
    assert main(["info", str(mixed)]) == 0
    assert "Warning" not in capsys.readouterr().out
    assert main([*REACH, "tier=gusts", "expert.noise=0.1", "seed=4", "mix=true", f"out={mixed}"]) == 0
    capsys.readouterr()
    assert main(["info", str(mixed), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    kinds = {(kind["tier"], kind["settings"]): kind["episodes"] for kind in result["made_by"]}
    assert kinds == {("calm", "noise=0.3"): 2, ("gusts", "noise=0.1"): 2}
    assert result["repeated_seeds"] == [4]
    assert main(["info", str(mixed)]) == 0
    said = capsys.readouterr().out
    assert "1 seeds were flown more than once" in said
    assert "calm, gusts" in said
