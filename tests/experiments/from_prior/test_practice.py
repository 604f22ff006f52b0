"""What practice brought is told round by round and seed by seed, and no dip below the prior is missed."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.dapg import DAPG
from aerial_il.algorithms.expert_iteration import ExpertIteration
from aerial_il.policies.mlp import MLP
from experiments.common.demonstrations import Source
from experiments.common.practised import Continued, Practised
from experiments.common.stages import Cloned, trained_s
from experiments.from_prior.gains import gain_row, is_gain
from experiments.from_prior.practice import Arm, Practice, by_training, largest_dip


def rounds(*first: float, flown: int = 1000) -> list[dict[str, Any]]:
    """Rounds of ``flown`` steps each that began with these percentages of starts solved."""
    return [{"first_percent": percent, "flown": flown * (n + 1)} for n, percent in enumerate(first)]


@pytest.mark.parametrize(("percent", "dip"), [((50, 60), 0.0), ((50, 44, 90), 6.0), ((50, 52, 0), 50.0)])
def test_the_dip_is_the_largest_on_the_way_however_it_ends(percent: tuple[float, ...], dip: float) -> None:
    assert largest_dip(rounds(*percent)) == dip


def test_practice_after_practice_counts_both(tmp_path: Path) -> None:
    """Or a method would look as quick as its last stretch."""
    source = Source(robot="z1", task="reach")
    rounds = Practised("rounds", source, 2, MLP(), ExpertIteration(rounds=2))
    arm = Arm("dapg", 2, Continued("dapg", source, 2, MLP(), DAPG(), rounds))
    told = {
        "begun": [{"step": 1, "flight_steps": 900, "elapsed_s": 60.0}, {"step": 2, "flight_steps": 100}],
        "own": [
            {"step": 0, "evaluate/success": 0.5},
            {"step": 9, "episode/success": 0.2, "elapsed_s": 6.0},
            {"step": 255, "evaluate/success": 0.5},
            {"step": 500, "episode/success": 0.5, "elapsed_s": 30.0},
        ],
    }
    for name, rows in told.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "config.yaml").write_text("steps: 500\n")
        (tmp_path / name / "metrics.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))

    class Folders:
        def run_of(self, training: Any) -> Path:
            return tmp_path / ("begun" if training is rounds else "own")

        def minutes(self, trainings: Any) -> float:
            return sum(trained_s(self.run_of(training)) for training in trainings) / 60

    stages: Any = Folders()
    assert (arm.flown(stages), arm.minutes(stages)) == (1500, 1.5)
    practice = Practice(stages, [arm])
    assert [(row["flown"], row["minutes"]) for row in practice.listed] == [(1009, 1.1), (1500, 1.5)]
    assert [(row["flown"], row["minutes"]) for row in practice.on_the_way] == [(1000, 1.0), (1255, 1.3)]
    assert practice.dips[0]["exploring_dip"] == 0.0, "its own first 2 % end at step 10"
    alone = Arm("rounds", 2, rounds)
    assert (alone.flown(stages), alone.minutes(stages)) == (1000, 1.0)
    clone = Arm("bc", 2, Cloned("bc", source, 2, MLP(), BC()))
    assert clone.flown(stages) == 0


def test_a_dip_counts_once_the_first_steps_are_over() -> None:
    early = [{"first_percent": 50.0, "flown": 10}, {"first_percent": 20.0, "flown": 19}]
    assert largest_dip([*early, {"first_percent": 60.0, "flown": 1000}]) == 0.0
    assert largest_dip([*early, {"first_percent": 20.0, "flown": 20}, {"first_percent": 60.0, "flown": 1000}]) == 30.0


def test_what_is_kept_of_trainings_has_a_list_for_each_of_them() -> None:
    rows = [
        {"arm": "dapg", "task": "reach", "demos": 2, "draw": draw, "percent": percent, "flown": flown}
        for draw, percent, flown in ((0, 50.0, 0), (0, 60.0, 100), (1, 55.0, 0))
    ]
    assert by_training(rows) == {
        "reach from 2, dapg: 0": {"percent": [50.0, 60.0], "flown": [0, 100]},
        "reach from 2, dapg: 1": {"percent": [55.0], "flown": [0]},
    }


@pytest.mark.parametrize(("name", "met"), [("bc_ppo", False), ("filtered_bc", None)])
def test_no_method_may_fall_far_below_its_prior(name: str, met: bool | None) -> None:
    arm = Arm(name, 2, Practised(name, Source(robot="z1", task="reach"), 2, MLP(), ExpertIteration(rounds=2)))

    class Told(Practice):
        def _rounds(self, arm: Arm) -> Any:
            return rounds(50, 44, 90)

    assert [target.met for target in Told(None, [arm], ("filtered_bc",)).targets()] == ([] if met is None else [met])  # type: ignore[arg-type]


@pytest.mark.parametrize(("rates", "dip"), [((0.8, 0.1, 0.77, 0.9), 3.0), ((0.8, 0.1, 0.5, 0.9), 30.0), ((), None)])
def test_a_dip_is_that_of_flights_on_the_way(rates: tuple[float, ...], dip: float | None, tmp_path: Path) -> None:
    """However good practice looked meanwhile; and practice itself is judged where nothing was flown on the way."""
    source = Source(robot="z1", task="reach")
    clone = Cloned("bc", source, 2, MLP(), BC())
    training = Continued("dapg", source, 2, MLP(), DAPG(), clone, watched=3)
    (tmp_path / "config.yaml").write_text("steps: 1000\n")
    steps = (0, 10, 500, 1000)
    flown = [{"step": step, "evaluate/success": rate} for step, rate in zip(steps, rates, strict=False)]
    exploring = [{"step": step, "episode/success": rate} for step, rate in ((100, 0.9), (500, 0.7), (1000, 0.9))]
    (tmp_path / "metrics.jsonl").write_text("".join(json.dumps(row) + "\n" for row in (*flown, *exploring)))

    class Folder:
        def run_of(self, training: Any) -> Path:
            return tmp_path

    practice = Practice(Folder(), [Arm("dapg", 2, training)])  # type: ignore[arg-type]
    assert [row["percent"] for row in practice.on_the_way] == [100 * rate for rate in rates], "dips can be checked"
    drawn = [100 * rate for rate in rates] or [90.0, 70.0, 90.0]
    assert [(row["percent"], row["faint"]) for row in practice.lines] == [(percent, not rates) for percent in drawn]
    (row,), (target,) = practice.dips, practice.targets()
    assert (row["dip"], row["exploring_dip"]) == (dip and pytest.approx(dip), 20.0)
    assert target.measured == pytest.approx(20.0 if dip is None else dip)
    assert target.met == (dip == 3.0)


def flights(*solved: int, count: int = 20) -> Any:
    return SimpleNamespace(episodes=[SimpleNamespace(seed=seed, success=seed in solved) for seed in range(count)])


def test_flights_are_compared_seed_by_seed_within_each_training() -> None:
    """Two trainings; on seed 1 the first wins and the second loses, which is not nothing."""
    row = gain_row([(flights(0), flights(0, 1, 2)), (flights(1, 5), flights(5))])
    assert row == {"before": 7.5, "after": 10.0, "won": 2, "lost": 1, "p": 1.0}


@pytest.mark.parametrize(("won", "lost", "gained"), [(9, 0, True), (5, 0, False), (0, 9, False), (0, 0, False)])
def test_a_gain_is_more_than_luck(won: int, lost: int, gained: bool) -> None:
    row = gain_row([(flights(*range(10, 10 + lost)), flights(*range(won)))])
    assert (row["won"], row["lost"], is_gain(row)) == (won, lost, gained)
