"""The study of becoming faster than the teacher: times are compared like with like, and its targets can be missed."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.bc_ppo import BCPPO
from aerial_il.core.composition import build, changed
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.policies.mlp import MLP
from experiments.beyond_teacher.study import ASKED, CLONE, EXPERT, BeyondTeacher, targets_of, times_row
from experiments.common.practised import Continued
from experiments.common.stages import Stages
from tests.experiments.results import result_with


def flown(*times: float | None) -> Any:
    """An evaluation whose episodes, of seeds 0, 1, ..., succeeded at these times, or not at all."""
    episodes = [SimpleNamespace(seed=i, time_to_success_s=t) for i, t in enumerate(times)]
    return SimpleNamespace(episodes=episodes)


def test_nobody_becomes_faster_by_failing_where_it_takes_long() -> None:
    teacher = flown(2.0, 8.0)
    assert times_row([flown(2.0, None)], teacher)["of_expert"] == 100.0
    assert times_row([flown(1.0, 4.0), flown(2.0, 8.0)], teacher)["of_expert"] == 75.0, "over all trainings"
    assert times_row([flown(1.0, 4.0)], flown(2.0, None))["of_expert"] == 50.0, "where the teacher failed says nothing"
    assert times_row([flown(None, None)], teacher)["of_expert"] is None


def interval(results: list[Any], teacher: Any) -> tuple[float, float]:
    row = times_row(results, teacher)
    return row["of_expert_low"], row["of_expert_high"]


def test_only_differences_in_time_widen_the_interval() -> None:
    times = np.random.default_rng(0).uniform(2.0, 8.0, 50)
    assert interval([flown(*times)], flown(*times)) == (100.0, 100.0), "the expert against itself"
    assert interval([flown(*0.7 * times), flown(*0.7 * times)], flown(*times)) == (70.0, 70.0)
    low, high = interval([flown(*times[::-1])], flown(*times))
    assert low < 99.0 < 101.0 < high, "as long on average, by other seeds"


def test_trainings_on_the_same_seeds_are_not_independent() -> None:
    ours, teacher = np.random.default_rng(1).uniform(2.0, 8.0, (2, 50))
    alone = interval([flown(*ours)], flown(*teacher))
    assert alone[1] - alone[0] > 5.0
    assert interval([flown(*ours)] * 4, flown(*teacher)) == alone, "copies tell nothing new"


def test_the_interval_covers_the_ratio_of_the_means() -> None:
    rng = np.random.default_rng(2)
    held = []
    for _ in range(200):
        teacher = rng.uniform(2.0, 8.0, 40)
        by_seed = rng.normal(0.0, 0.8, 40)  # which all trainings share
        trained = [flown(*(0.7 * teacher + by_seed + rng.normal(0.0, 0.1, 40))) for _ in range(3)]
        low, high = interval(trained, flown(*teacher))
        held.append(low <= 70.0 <= high)
    assert 0.88 < np.mean(held) < 0.99


def test_an_expert_was_not_trained_and_has_no_minutes() -> None:
    row = next(BeyondTeacher().table_rows("reach", result_with(4, 3), {}, cast(Stages, None)))
    assert (row["arm"], row["minutes"], row["of_expert"]) == (EXPERT, None, 100.0)


def test_every_target_can_be_missed() -> None:
    def verdicts(of_expert: float | None, percent: float) -> list[bool | None]:
        ends = {"of_expert_low": of_expert, "of_expert_high": of_expert, "flights_low": 0.0, "flights_high": 100.0}
        rows = [
            {"task": "reach", "arm": EXPERT, "percent": 99.0},
            {"task": "reach", "arm": ASKED, "percent": percent, "of_expert": of_expert, **ends},
        ]
        return [target.met for target in targets_of(rows)]

    assert verdicts(75.0, 99.0) == [True, True]
    assert verdicts(75.1, 98.5) == [False, False]
    assert verdicts(None, 0.0) == [False, False], "a policy that never succeeds is not fast"


def test_what_practises_begins_with_the_very_clone_beside_it() -> None:
    trainings = BeyondTeacher().trainings("insert_peg", 1)
    practised = trainings[ASKED]
    assert isinstance(practised, Continued)
    assert practised.prior is not None
    assert practised.prior.decided_by() == trainings[CLONE].decided_by()
    with pytest.raises(InvalidValueError, match="start at 1"):
        BeyondTeacher(demos=0)


def test_the_page_names_robot_and_demonstrator() -> None:
    said = "Robot: fa_hexa_arm4, demonstrated by its scripted expert without noise, each task 200 times in calm."
    assert BeyondTeacher()._flown() == said


def test_a_task_can_have_settings_of_its_own() -> None:
    own = {"exploration": {"noise": 0.07, "execute": 5}}
    study = BeyondTeacher(suited={"insert_peg": own})
    practised = {task: study.trainings(task, 0)[ASKED].algorithm for task in study.tasks}
    assert practised == {
        "pick_place": study.practising,
        "insert_peg": changed(study.practising, own),
    }
    with pytest.raises(UnknownNameError, match="Did you mean 'noise'"):
        BeyondTeacher(suited={"insert_peg": {"exploration": {"nose": 0.07}}})


@pytest.mark.slow
def test_a_small_study_runs_and_goes_on_where_it_stopped(tmp_path: Path) -> None:
    cloning = BC(steps=10, batch_size=16)
    small = BeyondTeacher(
        policy=MLP(hidden=(16,)),
        cloning=cloning,
        practising=build(BCPPO, {"steps": 20_000, "rollout": {"steps": 8_000}, "warmup": 1_000, "reward_patience": 0}),
        tasks=("reach",),
        demos=2,
        draws=(0,),
        episodes=2,
        num_envs=2,
    )
    rows = small.run(tmp_path, progress=False).tables["Time to success"]
    assert [row["arm"] for row in rows] == [EXPERT, CLONE, ASKED]
    assert [row["flown"] > 0 for row in rows] == [False, False, True]
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")}
    small.run(tmp_path, progress=False)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.json")} == before
