"""The policies benchmark feeds all its arms the same windows and tells what each took."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from aerial_il.policies.mlp import MLP
from experiments.policies.study import OneByOne, Policies, prepared_for
from tests.algorithms.point_mass import demonstrations


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
    assert np.isclose(learning["ratio_loader"], learning["own_per_s"] / learning["loader_per_s"], rtol=0.05)
    assert [target.limit for target in report.targets] == [20.0, 2.0, 2.0]
    json.dumps(report.to_dict(), allow_nan=False)
