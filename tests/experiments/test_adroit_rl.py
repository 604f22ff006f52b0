"""The study of learning from demonstrations on the Adroit hand: what is shown, its control, what can be missed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from aerial_il.core.errors import InvalidValueError, UnknownNameError
from experiments.adroit.people import flown_by_people
from experiments.adroit.tasks import TASKS, PublishedRewards
from experiments.adroit_rl.study import ASKED, CELLS, CLONE, CONTROL, AdroitRl, Arm, targets_of
from experiments.common.outside import OutsideStages
from experiments.common.record import Record
from tests.experiments.results import result_with

DATA = Path("../shared/data/adroit")
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason=f"{DATA} is not there")


@needs_data
def test_what_people_flew_fits_the_environment() -> None:
    env = PublishedRewards(TASKS["door"], 1, CELLS["door"].max_steps)
    shown = flown_by_people(TASKS["door"], DATA, env.spec)
    env.close()
    assert len(shown) == CELLS["door"].demos
    assert {len(episode.obs["observation"]) - len(episode) for episode in shown} == {1}
    assert max(map(len, shown)) < env.spec.max_steps
    assert all((np.abs(episode.actions) <= 1.0).all() for episode in shown)


def test_a_clone_was_not_trained_for_itself_and_has_no_minutes(tmp_path: Path) -> None:
    stages = OutsideStages(record=Record(tmp_path))
    row = AdroitRl()._row(Arm("door", CLONE, "environment"), [result_with(4, 1)], stages)
    assert (row["minutes"], row["steps"], row["percent"]) == (None, 0, 25.0)


@needs_data
def test_draws_differ_where_experts_fly(tmp_path: Path) -> None:
    study, stages = AdroitRl(data=str(DATA)), OutsideStages(record=Record(tmp_path))
    expert, people = (
        [study.training(Arm(task, ASKED, "environment"), draw, stages).shown for draw in (0, 1)]
        for task in ("relocate", "door")
    )
    assert expert[0] != expert[1]
    assert people[0] == people[1]
    control = study.training(Arm("door", CONTROL, "environment"), 0, stages)
    assert control.shown is None
    assert control.algorithm.steps == study.dapg.steps


@needs_data
def test_a_control_that_never_sees_a_reward_flies_all_its_steps(tmp_path: Path) -> None:
    study, stages = AdroitRl(data=str(DATA)), OutsideStages(record=Record(tmp_path))
    arms = (Arm("door", CONTROL, reward) for reward in ("sparse", "environment"))
    sparse, dense = (study.training(arm, 0, stages).algorithm for arm in arms)
    assert sparse.reward_patience == 0
    assert dense.reward_patience == study.npg.reward_patience


def test_both_targets_can_be_missed() -> None:
    usual = {"steps": 1, "trainings": 1, "success": 1, "episodes": 1, "flights_low": 0.0, "flights_high": 100.0}
    usual |= {"trainings_low": None, "trainings_high": None, "worst": 0.0, "best": 0.0}

    def verdicts(asked: float, control: float) -> list[bool | None]:
        percents = {ASKED: asked, CONTROL: control}
        rows = {Arm("door", name, "environment"): {**usual, "percent": value} for name, value in percents.items()}
        return [target.met for target in targets_of(rows)]

    assert verdicts(80.0, 5.0) == [True, True]
    assert verdicts(79.0, 6.0) == [False, False]


def test_unknown_tasks_and_missing_data_are_answered(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="relocate"):
        AdroitRl(tasks=("pen",))
    with pytest.raises(InvalidValueError, match="start at 1"):
        AdroitRl(worlds=0)
    report = AdroitRl(data=str(tmp_path / "none")).run(tmp_path, progress=False)
    assert "bench.data=FOLDER" in report.tables["Skipped"][0]["why"]
