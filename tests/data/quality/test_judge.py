"""Bad demonstrations among good ones are found, whatever their units, and good ones are left alone."""

import shlex
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il.cli.main import main
from aerial_il.collection.collect import collect
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.episode import Episode
from aerial_il.data.quality.judge import Judgement, judge
from aerial_il.data.table import read_columns
from experiments.quality.planted import FLOWN, KINDS, SPOILED

ROBOT, TASK, GOOD = "fa_hexa_arm4", "pick_place", 48
Flights = tuple[list[Episode], dict[str, Episode]]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with good flights, and one of each that has a fault."""
    root = tmp_path_factory.mktemp("flights")
    with closing(aerial_il.load_batch(ROBOT, TASK, num_envs=16)) as env:
        expert = aerial_il.expert(ROBOT, TASK, noise=0.3)
        collect(env, expert, range(300, 300 + GOOD), root / "good", progress=False)
    for kind, fault in FLOWN.items():
        with closing(aerial_il.load_batch(ROBOT, TASK, num_envs=1)) as env:
            pilot = fault(aerial_il.expert(ROBOT, TASK, noise=0.3))
            collect(env, pilot, [900], root / kind, policy_name=kind, progress=False)
    return root


@pytest.fixture(scope="module")
def flights(folder: Path) -> Flights:
    """Return the good ones, and kind -> a bad one."""
    good = list(open_dataset(folder / "good"))
    flown = {kind: next(iter(open_dataset(folder / kind))) for kind in FLOWN}
    return good[1:], flown | {"late": SPOILED["late"](good[0]), "repeated": SPOILED["repeated"](good[5])}


@pytest.fixture(scope="module")
def found(flights: Flights) -> Judgement:
    good, bad = flights
    return judge([*good, *bad.values()])


REASON = {
    "pausing": "idle", "shaking": "jerk", "grabbing": "inconsistency", "straying": "idle", "late": "lag_s",
    "repeated": "repeated",
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_bad_is_suspect_for_its_reason(flights: Flights, found: Judgement, kind: str) -> None:
    assert REASON[kind] in found.suspects[flights[1][kind].uid]


def test_what_is_good_is_not(flights: Flights, found: Judgement) -> None:
    good, bad = flights
    assert len(found.suspects.keys() - {each.uid for each in bad.values()}) <= 2
    assert found.columns["repeats"][bad["repeated"].uid] == good[4].uid
    alone = judge(good)
    assert len(alone.suspects) <= 2


def test_units_do_not_matter(flights: Flights, found: Judgement) -> None:
    scaled = [in_millimetres(episode) for episode in [*flights[0], *flights[1].values()]]
    again = judge(scaled)
    assert again.suspects == found.suspects
    for name in ("idle", "jerk", "saturation", "inconsistency", "lag_s", "information"):
        was, now = ([float(each.columns[name][e.uid]) for e in scaled] for each in (found, again))
        np.testing.assert_allclose(now, was, rtol=0.02, atol=0.02)


def in_millimetres(episode: Episode) -> Episode:
    """Return an episode whose numbers are a thousand times as large."""
    action = replace(episode.spec.action, low=1e3 * episode.spec.action.low, high=1e3 * episode.spec.action.high)
    return replace(
        episode,
        spec=replace(episode.spec, action=action),
        obs={name: 1e3 * value for name, value in episode.obs.items()},
        executed_actions=1e3 * episode.executed_actions,
    )


def test_few_are_refused(flights: Flights) -> None:
    with pytest.raises(InvalidValueError, match="3 episodes are too few"):
        judge(flights[0][:3])


def test_the_command_keeps_columns(folder: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    merged = tmp_path / "all"
    good, shaky = folder / "good", folder / "shaking"
    assert main(["merge", str(good), str(shaky), f"out={merged}", "mix=true", "progress=false"]) == 0
    assert main(["judge", str(merged), "keep=false", "progress=false"]) == 0
    assert not read_columns(merged)
    _, _, advised = capsys.readouterr().out.rpartition("Next: aerial-il ")
    assert main([*shlex.split(advised), "progress=false"]) == 0, "what was not kept is named by its uids"
    assert next(iter(open_dataset(shaky).uids)) not in open_dataset(f"{merged}-sound").uids
    assert main(["judge", str(merged), "progress=false"]) == 0
    said = capsys.readouterr().out
    assert "demonstrations are suspect" in said
    assert "jerk 1" in said
    assert main(["filter", str(merged), "where=suspect == ''", f"out={tmp_path / 'sound'}", "progress=false"]) == 0
    kept = open_dataset(tmp_path / "sound").uids
    assert next(iter(open_dataset(shaky).uids)) not in kept
    assert len(kept) >= GOOD - 2


def test_without_states_actions_are_judged_alone(flights: Flights) -> None:
    blind = [
        replace(each, obs={k: 0.0 * v for k, v in each.obs.items()}) for each in [*flights[0], flights[1]["shaking"]]
    ]
    found = judge(blind)
    assert "inconsistency" not in found.columns
    assert found.suspects[flights[1]["shaking"].uid] == "jerk"
