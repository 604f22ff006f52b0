"""Behaviour cloning learns to fly, says how well, and keeps a readable record."""

import itertools
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy import stats

from aerial_il.algorithms.bc import BC
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.episode import Episode
from aerial_il.policies import load_policy
from aerial_il.policies.mlp import MLP
from tests.algorithms.point_mass import SPEC, demonstrations, success_rate

EPISODES = 100


@pytest.fixture(scope="module")
def demos() -> list[Episode]:
    return demonstrations(60)


def learn(demos: list[Episode], run: Path, **policy: object) -> float:
    settings = BC(steps=500, batch_size=128, lr=2e-3, warmup_steps=50, ema=0.99)
    config = MLP(**{"hidden": (128, 128), "chunk": 20, "masked_fields": (), **policy})  # type: ignore[arg-type]
    learned = settings.train(demos, config, run=run, progress=False)
    return success_rate(learned, episodes=EPISODES, seed=10_000)


def test_chunks_solve_what_single_steps_do_not(demos: list[Episode], tmp_path: Path) -> None:
    """On unseen seeds, far beyond chance: the demonstrator pauses, and a single-step policy stays in the pause."""
    chunked, single = learn(demos, tmp_path / "a", chunk=20), learn(demos, tmp_path / "b", chunk=1)
    table = [[round(EPISODES * rate), round(EPISODES * (1 - rate))] for rate in (chunked, single)]
    assert stats.fisher_exact(table, alternative="greater").pvalue < 1e-6
    assert chunked >= 0.5


def test_a_run_tells_what_it_did(demos: list[Episode], tmp_path: Path) -> None:
    cadence = replace(BC.cadence, log_every=10, checkpoint_every=15)
    settings = BC(steps=45, batch_size=32, validate_every=20, cadence=cadence)
    run = tmp_path / "run"
    settings.train(demos, MLP(hidden=(16,)), run=run, seed=5, progress=False, expect={"robot": "point"})
    rows = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    assert [row["step"] for row in rows] == [10, 20, 30, 40, 45]
    assert [row["step"] for row in rows if "validation/loss" in row] == [20, 40, 45]
    assert {f"validation/{label}" for label in SPEC.action.labels} < rows[-1].keys()
    assert rows[-1]["loss"] < rows[0]["loss"]
    config = yaml.safe_load((run / "config.yaml").read_text())
    assert (config["algorithm"], config["policy"]["name"], config["seed"]) == ("bc", "mlp", 5)
    assert config["dataset"]["demonstrations"] == 60
    assert "torch" in json.loads((run / "provenance.json").read_text())["packages"]
    assert list((run / "tensorboard").glob("events*"))
    assert load_policy(run).origin["step"] == 45


def test_validation_errors_are_in_the_units_of_the_action(demos: list[Episode], tmp_path: Path) -> None:
    """An untrained network predicts about the mean, so its error is about the mean deviation of the data."""
    settings = BC(steps=1, lr=1e-9, validation=0.5)
    settings.train(demos, MLP(hidden=(16,), anchor=None), run=tmp_path, progress=False)
    row = json.loads((tmp_path / "metrics.jsonl").read_text())
    actions = np.concatenate([d.expert_actions for d in demos])
    deviation = np.abs(actions - actions.mean(0)).mean(0)
    for label, size in zip(SPEC.action.labels, deviation, strict=True):
        if size > 0.01:
            assert 0.7 * size < row[f"validation/{label}"] < 1.8 * size


def test_time_can_end_a_run(demos: list[Episode], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "perf_counter", itertools.count(0.0, 0.001).__next__)  # a clock that each look moves on
    settings = BC(steps=10**9, minutes=0.01, batch_size=16)
    policy = settings.train(demos[:5], MLP(hidden=(16,)), run=tmp_path, progress=False)
    rows = [json.loads(line) for line in (tmp_path / "metrics.jsonl").read_text().splitlines()]
    assert 0.6 <= rows[-1]["elapsed_s"] < 0.7
    assert rows[-1]["lr"] < 2e-5
    assert policy.origin["step"] == rows[-1]["step"]


@pytest.mark.parametrize("expect", [{"robot": "fa_hexa_arm4"}, {"task": "reach"}, {"action": "velocity"}])
def test_other_data_than_asked_for_is_refused(demos: list[Episode], tmp_path: Path, expect: dict[str, str]) -> None:
    key, value = next(iter(expect.items()))
    with pytest.raises(InvalidValueError, match=f"{key}={value} was asked for"):
        BC().train(demos, MLP(), run=tmp_path, expect=expect)
