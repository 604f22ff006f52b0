"""Frames tell what the files of real runs, evaluations and recordings hold, and name what they cannot read."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.evaluation.metrics import EpisodeRecord
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.statistics import wilson
from aerial_il.presentation import analysis
from tests.presentation.pages.test_run_report import make_adversarial, make_other, make_run

RECORD = EpisodeRecord(0, "timeout", 100, 2.0, None, 30.0, 0.3, 0.01, 0.02, 0.2, {"m/s^3": 5.0}, 0, 0.0, {"near": None})


def evaluated(won: list[bool], *, task: str = "reach", first: int = 10000) -> EvaluationResult:
    """Return an evaluation in which these flights succeeded."""
    records = []
    for k, success in enumerate(won):
        solved = {"end": "success", "time_to_success_s": 1.0 + k, "return_": 40.0 + k, "subtasks": {"near": 0.5}}
        records.append(replace(RECORD, seed=first + k, **(solved if success else {})))
    return EvaluationResult("quad", task, "calm", "p", tuple(records), {})


def test_a_row_per_run_and_what_is_none_is_named(tmp_path: Path) -> None:
    for seed in (0, 1):
        evaluated([True, False]).save(make_run(tmp_path / f"seed={seed}", seed=seed) / "calm")
    (tmp_path / "half").mkdir()
    (tmp_path / "half" / "config.yaml").write_text("algorithm: bc\n")
    (make_run(tmp_path / "broken") / "metrics.jsonl").write_text('{"step": 1}\n{"st\n{"step": 3}\n')
    (tmp_path / "holiday").mkdir()
    with pytest.warns(UserWarning, match="is left out") as warned:
        frame = analysis.runs(tmp_path)
    told = " ".join(str(one.message) for one in warned)
    parts = ("half is left out: half-written", "broken", "line 2", "holiday is left out: holds no training run")
    assert [part for part in parts if part not in told] == []
    assert list(frame["run"]) == ["seed=0", "seed=1"]
    row = frame.iloc[1]
    assert (row.algorithm, row.policy, row.seed, row.episodes, row.steps) == ("bc", "mlp", 1, 80, 400)
    assert (row.robot, row.task, row.tier, row.environment) == ("quad", "reach", "calm", "suite")
    assert (row.success, row.flights, bool(row.finished)) == (0.7, 20, True)
    assert (row.low, row.high) == wilson(14, 20)


def test_what_a_run_flew_while_it_learned(tmp_path: Path) -> None:
    make_run(tmp_path / "clone")
    rows = [{"step": k, "flight_steps": 100.0 * k, "total/flight_steps": 1.0} for k in range(4)]
    make_other(tmp_path / "dagger", {"algorithm": "dagger", "environment": {}, "settings": {"rounds": 3}}, rows)
    make_adversarial(tmp_path / "gail")
    frame = analysis.runs(tmp_path).set_index("run")
    assert dict(frame["flown"]) == {"clone": 0, "dagger": 600, "gail": 15000}
    assert dict(frame["unit"]) == {"clone": "training step", "dagger": "round", "gail": "environment step"}


def test_no_runs_and_a_missing_folder(tmp_path: Path) -> None:
    assert analysis.runs(tmp_path).empty
    assert "success" in analysis.runs(tmp_path).columns
    with pytest.raises(InvalidValueError, match="aerial-il train"):
        analysis.runs(tmp_path / "nowhere")
    with pytest.raises(InvalidValueError, match="not a training run"):
        analysis.metrics(tmp_path)


def test_metrics_are_those_of_the_file_without_a_line_cut_short(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run")
    with (run / "metrics.jsonl").open("a") as file:
        file.write('{"step": 500, "lo')
    frame = analysis.metrics(run)
    assert len(frame) == 8
    assert list(frame["loss"].dropna()) == [1.0, 1 / 2, 1 / 3, 1 / 4]
    (run / "metrics.jsonl").write_text('{"step": 1, "loss": 2}\n{"loss": 3}\n')
    with pytest.raises(InvalidValueError, match=r"metrics\.jsonl, line 2"):
        analysis.metrics(run)
    (run / "metrics.jsonl").write_text("")
    assert list(analysis.metrics(run).columns) == ["step"]


def test_a_row_per_flight(tmp_path: Path) -> None:
    evaluated([True, False, True]).save(tmp_path)
    frame = analysis.evaluation(tmp_path)
    assert list(frame["seed"]) == [10000, 10001, 10002]
    assert list(frame["success"]) == [True, False, True]
    assert list(frame["return"]) == [40.0, 30.0, 42.0]
    assert list(frame["action_jerk_rms.m/s^3"]) == [5.0] * 3
    assert np.isnan(frame["time_to_success_s"].astype(float)[1])
    stored = json.loads((tmp_path / "evaluation.json").read_text())
    for text, why in (
        ('{"schema"', "not valid JSON"),
        ("[]", "schema"),
        (json.dumps(stored | {"episodes": 9}), "9 ep"),
    ):
        (tmp_path / "evaluation.json").write_text(text)
        with pytest.raises(InvalidValueError, match=why):
            analysis.evaluation(tmp_path)
    with pytest.raises(InvalidValueError, match="cannot be read"):
        analysis.evaluation(tmp_path / "nowhere")


def test_a_comparison_has_the_numbers_of_the_command() -> None:
    a, b = evaluated([True, False, False, False]), evaluated([True, True, True, False])
    frame = analysis.compare(a, b)
    assert tuple(frame.loc["success", ["a", "b", "difference", "p_value"]]) == (0.25, 0.75, 0.5, 0.5)
    assert (frame.attrs["only_a"], frame.attrs["only_b"], frame.attrs["paired"]) == ([], [10001, 10002], True)
    assert frame.loc["return", "a"] == pytest.approx((40 + 30 + 30 + 30) / 4)
    low, high = frame.loc["return", ["low", "high"]]
    assert 0 <= low < frame.loc["return", "difference"] < high <= 12
    with pytest.raises(InvalidValueError, match="one robot and task"):
        analysis.compare(a, evaluated([True], task="hover"))


def test_episodes_and_steps_of_recordings(tmp_path: Path) -> None:
    folder = tmp_path / "hover"
    aerial_il.collect("quad", "hover", episodes=2, seed=5000, num_envs=2, out=folder)
    recorded, frame = aerial_il.open_dataset(str(folder)), analysis.dataset(folder)
    assert list(frame["uid"]) == list(recorded.uids)
    assert list(frame["steps"]) == [len(one) for one in recorded]
    assert list(frame["seed"]) == [5000, 5001]
    assert frame["return"][0] == pytest.approx(recorded[0].total_reward)
    rows = analysis.steps(folder, 1)
    assert len(rows) == len(recorded[1])
    assert np.array_equal(rows["base_pos[2]"], recorded[1].obs["base_pos"][:-1, 2])
    first = f"action[{recorded[1].spec.action.labels[0]}]"
    assert np.array_equal(rows[first], recorded[1].executed_actions[:, 0])
    assert len(analysis.steps(folder)) == frame["steps"].sum()
    file = recorded.path / "demos" / f"{recorded.uids[0]}.mcap"
    file.write_bytes(file.read_bytes()[:2000])
    with pytest.warns(UserWarning, match=f"{file.stem} is left out"):
        assert list(analysis.dataset(folder)["uid"]) == [recorded.uids[1]]
    assert len(analysis.steps(folder)) == len(recorded[1])
    with pytest.raises(AerialError, match="does not exist"):
        analysis.dataset(tmp_path / "nowhere")
