"""Studies of speed compare arms that do the same work: stepping, learning and recording."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il.policies.mlp import MLP
from aerial_il.suite.batch import BatchEnvironment
from experiments.common.stopwatch import Arm, interleave
from experiments.policies.study import OneByOne, Policies, prepared_for
from experiments.recording.study import collecting_row, file_rows
from experiments.speed import study as speed
from experiments.speed.study import SECTIONS, Speed, time_of_a_step
from experiments.speed.workload import RawPhysics, Workload, fly_again, record
from tests.algorithms.point_mass import demonstrations

STEPS, WORLDS = 30, 2


@pytest.fixture(scope="module")
def env() -> Iterator[BatchEnvironment]:
    env = aerial_il.load_batch("ua_quad_arm4", "pick_place", num_envs=WORLDS, tier="gusts", num_threads=1)
    yield env
    env.close()


@pytest.fixture(scope="module")
def work(env: BatchEnvironment) -> Workload:
    return record(env, np.arange(WORLDS), STEPS)


def test_the_batch_environment_repeats_the_flight_bit_for_bit(env: BatchEnvironment, work: Workload) -> None:
    env.set_state(work.start)
    fly_again(env, work)
    np.testing.assert_array_equal(env.simulation.view.qpos, work.end)
    assert work.world_steps == STEPS * WORLDS


@pytest.mark.parametrize("way", ["step", "step_recorded", "roll_out"])
def test_the_bare_engine_does_the_same_physics_bit_for_bit(env: BatchEnvironment, work: Workload, way: str) -> None:
    raw = RawPhysics(env.model, work, 1)
    for _ in range(2):
        raw.rewind()
        getattr(raw, way)()
        np.testing.assert_array_equal(raw.qpos, work.end)


def test_a_policy_could_see_the_states_that_are_handed_out(env: BatchEnvironment, work: Workload) -> None:
    raw = RawPhysics(env.model, work, 1)
    raw.rewind()
    raw.step_recorded()
    rows = raw.seen[:, 1 : 1 + env.model.nq]  # a state begins with the time, then come the positions
    np.testing.assert_array_equal(rows, work.end)


def test_the_parts_of_a_step_add_up(env: BatchEnvironment, work: Workload) -> None:
    row = time_of_a_step(env, work)
    parts = [row[f"{name}_us"] for name in SECTIONS]
    assert min(parts) > 0.0
    assert np.isclose(sum(parts), row["total_us"], atol=0.05)
    np.testing.assert_array_equal(env.simulation.view.qpos, work.end)


def test_arms_take_turns_and_the_first_round_does_not_count() -> None:
    calls: list[str] = []
    arms = {name: Arm(lambda name=name: calls.append(name), units=10) for name in ("a", "b")}
    rates = interleave(arms, 2)
    assert calls == ["a", "b"] * 3
    assert {name: rate.shape for name, rate in rates.items()} == {"a": (2,), "b": (2,)}


TINY = Speed(
    robots=("ua_quad_arm4",), tasks=("pick_place",), num_envs=2, steps=5, repetitions=1, processes=2, demonstrations=2,
    threads=1,
)  # fmt: skip


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed, "SERIAL_WORLDS", 4)


@pytest.mark.slow
@pytest.mark.usefixtures("few")
def test_end_to_end_with_gymnasium_and_demonstrations(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed, "first_flight", lambda *_, **__: {"median_s": 4.0})
    report = TINY.run(tmp_path, progress=False)
    (row,) = report.tables["Speed"]
    assert [target.limit for target in report.targets] == [0.8, 3.5, 4.0, 3000, 3.0, 15.0, 1.0, 3.0]
    assert row["steps_per_s"] > 0
    assert np.isclose(row["ratio_raw"], row["steps_per_s"] / row["raw_steps_per_s"], rtol=0.01)
    assert min(row["ratio_gymnasium"], row["ratio_sb3"]) > 0.0
    assert report.tables["Demonstrations per minute"][0]["recorded_per_minute"] > 0
    assert not report.targets[-1].met, "four seconds to the first flight are too many"
    json.dumps(report.to_dict(), allow_nan=False)


def test_the_loader_gives_the_windows_that_training_gathers() -> None:
    demos, config = demonstrations(3), MLP(history=3, chunk=7)
    _, training, interface = prepared_for(config, demos)
    one_by_one = OneByOne(demos, interface, config)
    assert len(one_by_one) == len(training)
    index = np.array([0, 1, len(demos[0]) - 1, len(demos[0]), len(training) - 1])
    for i, *gathered in zip(index, *training.gather(index), strict=True):
        for own, loaded in zip(gathered, one_by_one[int(i)], strict=True):
            np.testing.assert_allclose(loaded, own, atol=1e-5)


def test_end_to_end(tmp_path: Path) -> None:
    settings = Policies(
        policies=("mlp",), demonstrations=1, calls=10, num_envs=3, batch_size=8, steps=1, repetitions=1, workers=0
    )
    report = settings.run(tmp_path, progress=False)
    (acting,), (learning,) = report.tables["Time to act"], report.tables["Optimisation steps per second"]
    assert 0 < acting["alone_p50_ms"] <= acting["alone_p99_ms"]
    ratio = learning["own_per_s"] / learning["loader_per_s"]
    assert np.isclose(learning["ratio_loader"], ratio, rtol=0.05, atol=0.01), "both rounded"
    assert [target.limit for target in report.targets] == [20.0, 2.0, 2.0]
    json.dumps(report.to_dict(), allow_nan=False)


MEASURED = {"flown": [10.0, 20.0, 10.0], "collected": [9.0, 18.0, 5.0], "read": [400.0, 100.0, 500.0]}


def test_shares_are_formed_within_a_turn() -> None:
    row = collecting_row(MEASURED)
    assert (row["collected_per_minute"], row["share_percent"], row["share_range"]) == (540, 10.0, "10.0-50.0")
    assert list(file_rows(MEASURED)) == [{"work": "read", "episodes_per_s": 400.0}]
