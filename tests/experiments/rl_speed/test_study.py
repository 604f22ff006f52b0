"""The speed benchmark of reinforcement learning trains all online algorithms as they ship and tells where time goes."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from aerial_il import algorithms
from experiments.rl_speed.study import RlSpeed, online_algorithms


def test_every_algorithm_that_flies_while_it_learns_is_timed() -> None:
    names = online_algorithms()
    assert {"ppo", "sac", "dqn", "gail", "bc_ppo", "ibrl"} <= set(names)
    assert not {"bc", "dagger", "filtered_bc"} & set(names)


@pytest.mark.parametrize("name", online_algorithms())
def test_only_the_length_is_changed_of_what_ships(name: str, tmp_path: Path) -> None:
    settings = RlSpeed(steps=100).settings(name, tmp_path)
    changed = ("steps", "warmup", "offline_steps", "bc_pretrain_steps", "prior", "cadence")
    default = {key: getattr(algorithms.get(name)(), key) for key in changed if hasattr(settings, key)}
    assert replace(settings, **default) == algorithms.get(name)()
    stretch = settings.cadence.evaluate_every
    assert settings.steps == 2 * stretch
    assert not hasattr(settings, "rollout") or stretch >= settings.rollout.steps
    if hasattr(settings, "replay"):
        assert settings.warmup < stretch, "what is measured learns all the time"


@pytest.mark.parametrize(("name", "parts"), [("a2c", ("simulation", "acting", "learning")), ("dqn", ("replay",))])
def test_end_to_end(name: str, parts: tuple[str, ...], tmp_path: Path) -> None:
    study = RlSpeed(
        algorithms=(name,), robot="floating_gripper", task="reach", demonstrations=1, steps=400, repetitions=1
    )
    report = study.run(tmp_path, progress=False)
    (row,) = report.tables["Speed"]
    assert row["slowest"] == row["steps_per_s"] == row["fastest"] > 0
    shares = [row[f"{part}_percent"] for part in ("simulation", "acting", "replay", "learning")]
    assert sum(shares) == pytest.approx(100, abs=0.3)
    assert all(row[f"{part}_percent"] > 0 for part in parts)
    assert name in report.figures["rl_speed.svg"]
    assert report.notes[0].startswith(
        "Robot: floating_gripper, demonstrated by its scripted expert without noise 1 times"
    )
    json.dumps(report.to_dict(), allow_nan=False)
