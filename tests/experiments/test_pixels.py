"""The study of pixels: each policy beside its blind control, from the same demonstrations."""

from __future__ import annotations

from pathlib import Path

import pytest

from aerial_il.algorithms.bc import BC
from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.mlp import MLP
from experiments.pixels import study as pixels
from experiments.pixels.study import POSE, Pixels


def test_a_target_asks_for_more_than_the_blind_reach() -> None:
    seeing = {"task": "reach", "sees": "images", "percent": 60.0, "flights_low": 50.0, "flights_high": 69.0}
    seeing |= {"trainings_low": None, "trainings_high": None}
    blind = {**seeing, "sees": "blind", "percent": 40.0, "flights_high": 49.0}
    assert [target.met for target in pixels.targets_of([seeing, blind])] == [True]
    assert [target.met for target in pixels.targets_of([seeing, {**blind, "flights_high": 51.0}])] == [False]


def test_a_policy_without_images_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="sees no images"):
        Pixels(policy=MLP())


@pytest.mark.slow
@pytest.mark.render
def test_both_learn_from_the_same_recordings(tmp_path: Path) -> None:
    study = Pixels(
        policy=MLP(hidden=(8,), image_features=4, obs_names=POSE, images=("wrist_rgb",)),
        algorithm=BC(steps=2, batch_size=4, validation=0.0),
        tasks=("reach",),
        demos=1,
        image_size=(24, 24),
        draws=(0,),
        episodes=1,
        num_envs=1,
        threads=1,
    )
    report = study.run(tmp_path, progress=False)
    assert [row["sees"] for row in report.tables["Success on images"]] == ["images", "blind"]
    assert len(list(tmp_path.rglob("*.mcap"))) == 1
    assert len(report.targets) == 1
