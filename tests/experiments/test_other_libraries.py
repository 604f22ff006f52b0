"""Studies beside Stable-Baselines3 and on panda-gym: like is compared with like, and targets can be missed."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from aerial_il.core.errors import InvalidValueError, UnknownNameError
from experiments.common.outside import mean_of_last
from experiments.panda import study as panda
from experiments.panda.study import PUSH, REACH, Arm, Panda
from experiments.sb3.cells import Cell, cells
from experiments.sb3.study import Sb3, interval_ends, table_rows, targets_of, times_sooner
from experiments.sb3.theirs import Found


@pytest.mark.parametrize("name", cells())
def test_both_sides_have_the_same_network_and_batch(name: str) -> None:
    cell = cells()[name]
    theirs, ours = cell.theirs.settings, asdict(cell.ours)
    assert tuple(cell.theirs.network["net_arch"]) == asdict(cell.policy)["hidden"]
    drawn = ours["rollout" if "rollout" in ours else "replay"]
    assert theirs.get("batch_size", 256) == drawn["batch_size"]
    assert theirs.get("gamma", 0.99) == ours["gamma"]
    if "n_steps" in theirs:
        assert theirs["n_steps"] * cell.worlds == drawn["steps"]
    assert any((cell.wanted, cell.as_theirs, cell.sooner)), "a comparison without a target"


def result(mean: float, when: float) -> Found:
    """A side that reaches ``mean`` after ``when`` seconds and stays there."""
    return Found([mean] * 3, 10.0, [(1.0, when / 2, mean / 2), (2.0, when, mean), (3.0, 10.0, mean)])


def test_sooner_is_the_time_to_what_both_reach() -> None:
    assert times_sooner([(result(100.0, 2.0), result(100.0, 6.0))]) == [3.0]
    assert times_sooner([(result(200.0, 2.0), result(100.0, 6.0))]) == [6.0], "ours was there with its first half"
    assert times_sooner([(Found([1.0], 1.0, []), result(1.0, 1.0))]) is None


def test_every_target_can_be_missed() -> None:
    cell = replace(cells()["ppo_reach"], wanted=50.0, as_theirs=True)
    better, worse = result(60.0, 2.0), result(40.0, 6.0)
    assert [target.met for target in targets_of("any", cell, [(better, worse)])] == [True, True, True]
    assert [target.met for target in targets_of("any", cell, [(worse, better)])] == [False, False, False]


def test_who_is_sooner_may_fly_no_worse() -> None:
    """The return that both reach sooner is flown with exploration, which a policy may need."""
    sooner = [Found([40.0] * 3, 10.0, result(60.0, 2.0).curve), result(50.0, 6.0)]
    targets = targets_of("any", cells()["ppo_reach"], [(sooner[0], sooner[1])])
    assert [(target.limit, target.met) for target in targets] == [(50.0, False), (2.0, True)]
    assert [target.what.partition(": ")[2] for target in targets] == [
        "return without exploration, no worse than theirs",
        "times sooner at the same return with exploration",
    ]


def test_an_interval_stays_within_what_a_return_can_be() -> None:
    cart_pole, anything = cells()["dqn_cartpole"].bounds, cells()["ppo_half_cheetah"].bounds
    assert interval_ends(np.array([19.0, 500.0, 500.0]), cart_pole) == {"low": 0.0, "high": 500.0}
    assert interval_ends(np.array([500.0, 400.0]), cart_pole) == {"low": 0.0, "high": 500.0}
    assert interval_ends(np.array([500.0, 400.0]), anything) == {"low": None, "high": None}, "of two it says nothing"
    assert interval_ends(np.array([1.0, 2.0, 3.0]), anything) == {"low": -0.5, "high": 4.5}
    assert interval_ends(np.array([500.0]), cart_pole) == {"low": None, "high": None}


def test_a_comparison_that_takes_long_is_made_with_fewer_seeds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[tuple[str, int]] = []

    def side(study: Sb3, cell: Cell, seed: int, stages: object) -> Found:
        made.append((cell.task, seed))
        return result(cell.wanted or 1.0, 2.0)

    monkeypatch.setattr(Sb3, "_ours", side)
    monkeypatch.setattr(Sb3, "_theirs", side)
    monkeypatch.setattr("experiments.sb3.study.INSTALLED", True)
    report = Sb3(cells=("ppo_reach", "ppo_cartpole")).run(tmp_path, progress=False)
    assert [row["trainings"] for row in report.tables["Both sides"]] == [3, 3, 1, 1]
    assert set(made) == {("CartPole-v1", 0), ("CartPole-v1", 1), ("CartPole-v1", 2), ("fa_hexa_arm4:reach", 0)}
    with pytest.raises(UnknownNameError, match="Did you mean 'ppo_reach'"):
        Sb3(fewer={"ppo_reac": 1})


def test_flights_of_the_mean_stand_beside_training() -> None:
    pair = (Found([1.0, 3.0], 10.0, [(1.0, 1.0, 5.0), (2.0, 2.0, 7.0)]), Found([4.0], 10.0, []))
    ours, theirs = table_rows("any", cells()["ppo_reach"], [pair])
    assert (ours["return"], ours["exploring"]) == (2.0, 7.0)
    assert (theirs["return"], theirs["exploring"], theirs["steps"]) == (4.0, None, None), "no episode ended on the way"


def test_a_cell_of_the_suite_is_the_same_on_both_sides() -> None:
    cell: Cell = cells()["ppo_reach"]
    world, batch = cell.maker()(), cell.learned().open(1)
    try:
        seen, _ = world.reset(seed=20)
        ours = batch.reset(np.array([20]))
        assert set(seen) == set(ours)
        for name in ours:
            np.testing.assert_allclose(seen[name], ours[name][0], atol=1e-6)
    finally:
        world.close()
        batch.close()


def test_curves_of_ours_are_means_of_as_many_episodes_as_theirs() -> None:
    """Else a lucky handful of episodes would count as having been sooner."""
    ended = [(10.0, 150), (40.0, 20), (100.0, 5)]
    assert mean_of_last(ended[:1]) == 10.0
    assert mean_of_last(ended[:2]) == pytest.approx(0.8 * 10.0 + 0.2 * 40.0)
    assert mean_of_last(ended) == pytest.approx(0.75 * 10.0 + 0.2 * 40.0 + 0.05 * 100.0)
    assert mean_of_last(ended[1:]) == pytest.approx(0.8 * 40.0 + 0.2 * 100.0), "all there were"


def test_every_target_of_panda_can_be_missed() -> None:
    def verdicts(worst: float, result: float) -> list[bool | None]:
        row = {"success": 1, "episodes": 1, "trainings": 1, "worst": worst, "return": result, "worst_return": result}
        return [target.met for target in panda.targets_of({Arm(REACH, "sac"): row, Arm(PUSH, "sac"): row})]

    assert verdicts(100.0, -1.9) == [True, True, True]
    assert verdicts(99.5, -2.1) == [False, False, True]
    assert verdicts(94.5, -2.1) == [False, False, False]


def test_what_is_missing_or_unknown_is_answered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UnknownNameError, match="PandaReach-v3"):
        Panda(tasks=("PandaReach",))
    with pytest.raises(InvalidValueError, match="start at 1"):
        Panda(worlds=0)
    monkeypatch.setattr(panda, "find_spec", lambda name: None)
    report = Panda().run(tmp_path, progress=False)
    assert "pip install" in report.tables["Skipped"][0]["why"]
    assert report.targets == ()
