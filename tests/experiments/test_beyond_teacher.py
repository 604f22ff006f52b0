"""The study of becoming faster than the teacher: times are compared like with like, and its targets can be missed."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from aerial_il.core.errors import InvalidValueError
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
