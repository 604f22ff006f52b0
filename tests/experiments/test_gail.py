"""The study of imitation without reward: what it trains, and how it judges."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from experiments.common.record import Record
from experiments.gail import ratios
from experiments.gail.ratios import LIKE
from experiments.gail.study import Gail, Point


def result(*returns: float) -> Any:
    """Stand in for an evaluation."""
    return SimpleNamespace(episodes=[SimpleNamespace(return_=value, success=value > 50) for value in returns])


def test_trainings_differ_in_demonstrations_and_worlds(tmp_path: Path) -> None:
    study, record = Gail(methods=("gail", LIKE), suite={"reach": 250}, outside=()), Record(tmp_path)
    first, second = (study._decided_by(Point("reach", "gail", "none", seed), record) for seed in (0, 1))
    assert first["shown"]["draw"] != second["shown"]["draw"]
    outside = Gail(methods=("gail", LIKE), outside=("Hopper-v5",))
    many, like = (outside._decided_by(Point("Hopper-v5", method, "none", 0), record) for method in ("gail", LIKE))
    assert (many["worlds"], like["worlds"]) == (32, 8)
    assert many["algorithm"] == like["algorithm"]


def test_ratios_are_to_the_expert(tmp_path: Path) -> None:
    expert = result(100.0, 100.0)
    row = ratios.row("Hopper-v5", "dac", "none", [result(90.0, 110.0)], expert, [])
    assert row["ratio"] == 1.0
    assert row["ratio_low"] <= 1.0 <= row["ratio_high"]
    control = ratios.row("Hopper-v5", "dac", "random_actions", [result(1.0, 2.0)], expert, [])
    assert [target.met for target in ratios.targets([row, control], {})] == [True]
    clone = ratios.row("Hopper-v5", "clone alone", "none", [result(101.0)], expert, [])
    assert [target.met for target in ratios.targets([row], {"Hopper-v5": clone})] == [False], "its start was better"
    reach = ratios.row("reach", "dac", "none", [result(90.0, 10.0)], expert, [])
    assert [target.met for target in ratios.targets([reach], {})] == [False]


PEER = {
    "task": "Hopper-v5", "library": "imitation 1.0.1 GAIL", "settings": "published settings", "worlds": 8,
    "processes": "one process", "steps": 10, "returns": [[50.0, 52.0], [48.0, 50.0]], "train_s": 60.0,
}  # fmt: skip


def test_what_the_peer_reached_stands_in_the_same_table(tmp_path: Path) -> None:
    (tmp_path / "Hopper-v5-published-8.json").write_text(json.dumps(PEER))
    expert = result(100.0, 100.0)
    (peer,) = ratios.peer_rows(tmp_path, {"Hopper-v5": expert})
    own = ratios.row("Hopper-v5", "dac", "none", [result(90.0)], expert, [])
    assert list(peer) == list(own)
    assert (peer["ratio"], peer["train_min"], peer["trainings"], peer["each"]) == (0.5, 1.0, 2, "0.510 0.490")
    assert peer["method"] == "imitation 1.0.1 GAIL, published settings, 8 worlds, one process"
    assert peer["trainings_low"] < peer["ratio_low"] <= 0.5 <= peer["ratio_high"] < peer["trainings_high"]
    assert not ratios.peer_rows(tmp_path, {})


def arm(method: str, value: float, *, minutes: float = 1.0, trainings: int = 3, half: float = 0.05) -> dict[str, Any]:
    ends = {"ratio": value, "trainings_low": value - half, "trainings_high": value + half}
    common = {"task": "Hopper-v5", "control": "none", "steps": 1_000, "train_min": minutes, "trainings": trainings}
    return {**common, "method": method, **ends}


def test_a_peer_is_compared_like_with_like() -> None:
    peer = arm("imitation 1.0.1 GAIL, published settings, 8 worlds, one process", 0.8, minutes=2.5)
    better = [arm("gail", 0.95), arm(LIKE, 0.69), peer]
    met = {target.what.split(":")[0]: target.met for target in ratios.peer_targets(better)}
    assert met == {
        "Hopper-v5, 8 worlds each": False,
        f"Hopper-v5, {LIKE} beside {peer['method']}": False,
        "Hopper-v5, each at its best": True,
    }
    equal = [arm(LIKE, 0.76), {**peer, "train_min": 3.0}]
    assert all(target.met for target in ratios.peer_targets(equal)), "within the intervals, and three times as fast"


def test_too_few_trainings_are_not_compared() -> None:
    peer = arm("imitation 1.0.1 GAIL, published settings, 8 worlds, one process", 0.8)
    found = list(ratios.peer_targets([arm(LIKE, 0.1, trainings=2, half=5.0), peer]))
    assert [target.unit for target in found] == ["times"]
    longer = {**arm(LIKE, 0.9), "steps": 2_000}
    assert [target.unit for target in ratios.peer_targets([longer, peer])] == ["times"], "nor are longer ones"
    assert not list(ratios.peer_targets([arm(LIKE, 0.9)]))
