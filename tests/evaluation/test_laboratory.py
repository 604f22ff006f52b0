"""Policies under conditions: twins are matched seed by seed, failures have kinds, and equal policies seem equal."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aerial_il.core.errors import InvalidValueError
from aerial_il.evaluation import statistics
from aerial_il.evaluation.failures import kind_of, kinds_of
from aerial_il.evaluation.laboratory import Condition, compared, profile
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.presentation.pages.conditions import write_conditions
from tests.experiments.results import result_with

TWINS = result_with(100, 90)


def flown_as(won: np.ndarray, tier: str = "calm") -> EvaluationResult:
    """Return an evaluation whose flights ended as ``won`` (N,) bool."""
    ends = [
        replace(episode, end="success" if each else "timeout")
        for episode, each in zip(result_with(len(won), 0).episodes, won, strict=True)
    ]
    return replace(TWINS, tier=tier, episodes=tuple(ends))


def test_a_condition_is_a_strength_on_top_of_a_tier_or_a_tier() -> None:
    assert Condition.of("wind=2", "calm") == Condition("wind=2", "calm+wind:2")
    assert Condition.of("noise=3", "gusts").tier == "gusts+noise:3"
    assert Condition.of("hard-payload", "calm").tier == "hard-payload"
    assert Condition.of("wind=2", "calm").folder == "wind-2"


def test_each_flight_is_compared_with_its_twin() -> None:
    won = np.arange(100) < 90
    disturbed = won.copy()
    disturbed[:30] = False
    disturbed[95] = True
    found = compared({"mlp": {"calm": [flown_as(won)], "wind=2": [flown_as(disturbed, "calm+wind:2")]}}, "calm")
    calm, wind = found.rows
    assert (calm.rate, calm.difference_ci95, calm.p_adjusted) == (0.9, None, None)
    assert wind.difference == pytest.approx(-0.29)
    assert (wind.lost, wind.gained) == (tuple(range(30)), (95,))
    assert wind.p_value == statistics.mcnemar(30, 1) == wind.p_adjusted
    assert wind.difference_ci95 == statistics.paired_difference(30, 1, 100)


def test_p_values_are_corrected_for_all_rows_at_once() -> None:
    rng = np.random.default_rng(0)
    flown = {str(k): [flown_as(rng.random(100) < rate)] for k, rate in enumerate((0.9, 0.8, 0.75, 0.6))}
    found = compared({"mlp": flown}, "0")
    raw = [row.p_value for row in found.rows[1:] if row.p_value is not None]
    assert [row.p_adjusted for row in found.rows[1:]] == pytest.approx(statistics.holm(raw))
    assert "adjusted for 3 comparisons" in found.note


def test_intervals_of_several_trainings_cover_trainings_and_seeds() -> None:
    rng = np.random.default_rng(1)
    trainings = [flown_as(rng.random(100) < rate) for rate in (0.5, 0.7, 0.95)]
    worse = [flown_as(rng.random(100) < rate) for rate in (0.3, 0.5, 0.6)]
    found = compared({"mlp": {"calm": trainings, "gusts": worse}}, "calm")
    calm, gusts = found.rows
    pooled = statistics.wilson(calm.success, calm.episodes)
    assert calm.trainings == 3
    assert calm.ci95.hi - calm.ci95.lo > pooled.hi - pooled.lo
    assert gusts.p_adjusted is not None
    assert gusts.p_adjusted < 0.05
    assert found.rates["mlp"]["gusts"] == tuple(result.success["rate"] for result in worse)


def test_an_interval_has_width_even_where_all_succeed() -> None:
    every = [flown_as(np.ones(100, bool))] * 3
    calm, wind = compared({"mlp": {"calm": every, "wind": every}}, "calm").rows
    assert calm.ci95 == statistics.wilson(100, 100)
    assert wind.difference_ci95 == statistics.paired_difference(0, 0, 100)


def test_equal_policies_seem_different_in_few_of_200_comparisons() -> None:
    """Both sides draw from one and the same policy; 5 % may err by chance, and exact tests err less."""
    rng, wrong = np.random.default_rng(2), 0
    for rate in rng.uniform(0.3, 0.95, 200):
        one, other = (flown_as(rng.random(200) < rate) for _ in range(2))
        (_, row) = compared({"mlp": {"a": [one], "b": [other]}}, "a").rows
        assert row.p_adjusted is not None
        wrong += row.p_adjusted < 0.05
    assert wrong <= 14


@pytest.mark.parametrize(
    ("flown", "says"),
    [
        ({"mlp": {"gusts": [TWINS]}}, "mlp was not flown in calm"),
        ({"mlp": {"calm": [TWINS], "gusts": [result_with(90, 80)]}}, "do not match: 10 seeds, 90 first"),
        (
            {"mlp": {"calm": [TWINS], "gusts": [replace(TWINS, episodes=TWINS.episodes[::-1])]}},
            "list their seeds in another order",
        ),
        ({"mlp": {"calm": [TWINS, TWINS], "gusts": [TWINS]}}, "has 1 trainings under gusts and 2 undisturbed"),
        ({"mlp": {"calm": [TWINS, result_with(90, 80)]}}, "flew other seeds, 100 from 0 and 90 from 0"),
        (
            {"mlp": {"calm": [TWINS]}, "act": {"calm": [replace(TWINS, provenance={"engine": "0"})]}},
            "cannot stand in one table: engine None != 0",
        ),
    ],
)
def test_what_does_not_match_is_refused(flown: dict, says: str) -> None:
    with pytest.raises(InvalidValueError, match=says):
        compared(flown, "calm")


def test_failures_have_kinds(diver: EvaluationResult) -> None:
    base = TWINS.episodes[0]
    done = {"at_cube": 1.0, "grasped": 2.0, "in_bowl": None}
    assert kind_of(replace(base, end="success")) == ""
    assert kind_of(replace(base, end="crash", subtasks={**done, "grasped": None})) == "crash before grasped"
    assert kind_of(replace(base, end="timeout", subtasks=done)) == "out of time before in bowl"
    whole = kind_of(replace(base, end="dropped", subtasks={**done, "in_bowl": 3.0}))
    assert whole == "dropped: all sub-tasks done, not held"
    kinds = kinds_of(diver.episodes)
    assert sum(kinds.values()) == len(diver.episodes) - diver.success["count"]
    assert list(kinds.values()) == sorted(kinds.values(), reverse=True)


def test_a_map_shows_the_flights_of_its_own_task(tmp_path: Path) -> None:
    one = flown_as(np.arange(4) < 4)
    other = replace(flown_as(np.arange(4) < 1), task="land")
    flown = {"mlp": {"calm": [one, other]}}
    starts = {task: {seed: ("ee_pos", 0.1 * seed, 0.0) for seed in range(4)} for task in (one.task, "land")}
    page = write_conditions(tmp_path / "page.html", compared(flown, "calm"), flown, starts=starts).read_text()
    assert "3 of 4 failed" in page
    assert "0 of 4 failed" in page


def test_maps_that_are_left_out_are_counted(tmp_path: Path) -> None:
    one = flown_as(np.arange(4) < 2)
    flown = {f"method {k}": {each: [one] for each in ("calm", *"abcde")} for k in range(5)}
    starts = {one.task: {seed: ("ee_pos", 0.1 * seed, 0.0) for seed in range(4)}}
    page = write_conditions(tmp_path / "page.html", compared(flown, "calm"), flown, starts=starts).read_text()
    shown = page.split('id="maps"')[1]
    assert shown.count("<figure") == 24
    assert "6 more are left out" in shown
    assert all(f"method {k}, " in shown for k in range(5))


def test_a_profile_counts_the_runs_above_each_threshold() -> None:
    thresholds, shares = profile([0.2, 0.5, 0.5, 1.0])
    at = dict(zip(np.round(thresholds, 2).tolist(), shares.tolist(), strict=True))
    assert (at[0.0], at[0.2], at[0.21], at[0.5], at[0.51], at[1.0]) == (1.0, 1.0, 0.75, 0.75, 0.25, 0.25)
