"""One small trained run and its data, shared by tests that only read them."""

from __future__ import annotations

from pathlib import Path

import pytest

from aerial_il.algorithms.bc import BehaviourCloning
from aerial_il.data.episode import Episode
from aerial_il.policies.mlp import MlpConfig
from tests.algorithms.point_mass import demonstrations

TINY_POLICY = MlpConfig(hidden=(32, 32), chunk=8, history=2, dropout=0.1)
TINY = BehaviourCloning(steps=60, batch_size=32, log_every=7, validate_every=20, checkpoint_every=10, obs_noise=0.01)


@pytest.fixture(scope="session")
def demos() -> list[Episode]:
    return demonstrations(12)


@pytest.fixture(scope="session")
def finished_run(demos: list[Episode], tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("runs") / "tiny"
    TINY.train(demos, TINY_POLICY, run=run, progress=False)
    return run
