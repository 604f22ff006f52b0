"""Every number of an episode against a hand-made one, and sums against NumPy."""

import dataclasses

import numpy as np
import pytest

from aerial_il.evaluation.metrics import (
    EpisodeRecord,
    action_fast_share,
    aggregate,
    derivative_rms,
    measure,
    metrics_of,
    spread,
)
from aerial_il.evaluation.traces import Trace
from tests.data.crane import crane_spec

SPEC = crane_spec()
DT_S = SPEC.control_dt_s


def trace(steps: int = 6, **changes: object) -> Trace:
    columns = {
        "seed": 3,
        "success": True,
        "crash": False,
        "reward": np.linspace(0.0, 1.0, steps),
        "ee_error_m": np.linspace(0.05, 0.0, steps),
        "effort": np.full(steps, 0.25),
        "contacts": np.zeros(steps, dtype=int),
        "subtasks": np.zeros((steps, 2), dtype=bool),
        "actions": np.zeros((steps, 2)),
        "executed": np.zeros((steps, 2)),
        "ee_pos": np.zeros((steps, 3)),
        "phase": np.zeros(steps, dtype=int),
    }
    return Trace(**(columns | changes))


def test_a_success_is_timed_by_its_last_step() -> None:
    record = measure(trace(), SPEC)
    assert (record.end, record.steps, record.duration_s, record.time_to_success_s) == ("success", 6, 0.12, 0.12)
    assert record.return_ == pytest.approx(3.0)
    assert record.mean_reward == pytest.approx(0.5)
    assert (record.ee_error_mean_m, record.ee_error_max_m) == pytest.approx((0.025, 0.05))
    assert record.effort_mean == 0.25


@pytest.mark.parametrize(
    ("crash", "dropped", "end"),
    [(True, False, "crash"), (False, True, "dropped"), (True, True, "crash"), (False, False, "timeout")],
)
def test_a_failure_says_why_and_has_no_time_to_success(crash: bool, dropped: bool, end: str) -> None:
    record = measure(trace(success=False, crash=crash, dropped=dropped), SPEC)
    assert (record.end, record.success, record.time_to_success_s) == (end, False, None)


def test_an_end_effector_that_is_not_commanded_has_no_error() -> None:
    record = measure(trace(ee_error_m=np.full(6, np.nan)), SPEC)
    assert record.ee_error_mean_m is None
    assert record.ee_error_max_m is None


def test_the_raw_share_of_a_force_is_the_last_one_known() -> None:
    share = np.array([np.nan, 0.2, 0.5, 0.6, 0.8, np.nan])
    assert measure(trace(force_in_band_raw=share), SPEC).force_in_band_raw == 0.8
    assert measure(trace(force_in_band_raw=np.full(6, np.nan)), SPEC).force_in_band_raw is None


def test_contacts_are_counted_by_onset_and_time() -> None:
    record = measure(trace(contacts=np.array([2, 1, 0, 0, 3, 0])), SPEC)
    assert (record.contact_events, record.contact_time_s) == (2, 3 * DT_S)


def test_subtasks_keep_the_first_time_they_were_done() -> None:
    flags = np.zeros((6, 2), dtype=bool)
    flags[2, 0] = flags[4, 0] = True
    assert measure(trace(subtasks=flags), SPEC).subtasks == {"near": 3 * DT_S, "at_goal": None}


def test_jerk_of_a_cubic_is_its_third_derivative() -> None:
    time_s = np.arange(20) * DT_S
    actions = np.stack([time_s**3, 2 * time_s**3, time_s**2, np.sin(0 * time_s)], axis=1)
    jerk = derivative_rms(actions, ("m", "m", "", "m/s"), DT_S, order=3)
    assert jerk == pytest.approx({"m/s^3": np.sqrt((6**2 + 12**2) / 2), "1/s^3": 0.0, "m/s^4": 0.0}, abs=1e-6)
    assert derivative_rms(actions[:3], ("m", "m", "", "m/s"), DT_S, order=3) == {}, "it needs four steps"


def test_spread_ignores_what_is_missing_and_repeats() -> None:
    values = [1.0, None, 2.0, 6.0]
    summary = spread("x", values)
    assert (summary["count"], summary["mean"], summary["median"]) == (3, 3.0, 2.0)
    assert summary["std"] == pytest.approx(np.std([1, 2, 6], ddof=1))
    assert summary == spread("x", values)
    assert spread("x", [None])["mean"] is None


def test_aggregate_counts_ends_and_subtasks() -> None:
    flags = np.ones((6, 2), dtype=bool)
    flags[:, 1] = False
    records = [measure(trace(), SPEC), measure(trace(success=False, crash=True, subtasks=flags), SPEC)]
    summary = aggregate(records)
    assert summary["ends"] == {"success": 1, "crash": 1, "dropped": 0, "timeout": 0}
    assert (summary["crash"]["rate"], summary["contact"]["count"]) == (0.5, 0)
    assert [summary["subtasks"][name]["count"] for name in SPEC.subtasks] == [1, 0]
    assert summary["time_to_success_s"]["count"] == 1
    assert {metric.key for metric in metrics_of(records)} - {"return"} <= summary.keys()


def test_a_record_survives_its_dictionary() -> None:
    record = measure(trace(), SPEC)
    assert EpisodeRecord.from_dict(record.to_dict()) == record
    assert set(record.to_dict()) == {f.name for f in dataclasses.fields(record)} - {"return_"} | {"return", "success"}


def test_rate_of_a_ramp_is_its_slope() -> None:
    time_s = np.arange(20) * DT_S
    actions = np.stack([3 * time_s, 4 * time_s, 0 * time_s], axis=1)
    rate = derivative_rms(actions, ("m", "m", "m/s"), DT_S, order=1)
    assert rate == pytest.approx({"m/s": np.sqrt((3**2 + 4**2) / 2), "m/s^2": 0.0}, abs=1e-9)


def test_shaking_is_fast_and_a_manoeuvre_is_not() -> None:
    low, high, time_s = np.array([-1.0]), np.array([1.0]), np.arange(200) * 0.02
    slow, fast = (action_fast_share(low, high, np.sin(2 * np.pi * hz * time_s)[:, None], 0.02) for hz in (1.0, 12.0))
    assert slow is not None
    assert fast is not None
    assert slow < 0.05 < 0.95 < fast


def test_without_a_spectrum_there_is_no_fast_share() -> None:
    low, high, still = np.array([-1.0]), np.array([1.0]), np.zeros((200, 1))
    assert action_fast_share(low, high, still, 0.02) == 0.0
    assert action_fast_share(low, high, still[:10], 0.02) is None, "too short"
    assert action_fast_share(low, high, still, 0.1) is None, "5 Hz is the fastest there is"
    assert action_fast_share(-np.inf * high, high, still, 0.02) is None, "nothing to compare with"


def test_records_of_before_are_read_without_the_new_numbers() -> None:
    raw = measure(trace(), SPEC).to_dict()
    del raw["action_rate_rms"], raw["action_fast_share"]
    old = EpisodeRecord.from_dict(raw)
    assert (old.action_rate_rms, old.action_fast_share) == ({}, None)
    assert not any(metric.key.startswith("action_rate") for metric in metrics_of([old]))
