"""Train a small policy in a process of its own: ``python -m tests.algorithms.train_tiny RUN``."""

import sys
from collections.abc import Mapping
from typing import Any

from aerial_il.algorithms.bc import BC
from aerial_il.algorithms.run.cadence import Cadence
from aerial_il.data.episode import Episode
from aerial_il.policies.mlp import MLP
from tests.algorithms.point_mass import demonstrations

POLICY = MLP(hidden=(32, 32), chunk=8, history=2, dropout=0.1)
SETTINGS = BC(
    steps=120,
    batch_size=32,
    validate_every=25,
    obs_noise=0.01,
    cadence=Cadence(log_every=7, evaluate_every=40, checkpoint_every=10, keep_checkpoints=3),
)


def evaluate(policy: Any, step: int) -> Mapping[str, float]:
    """Stand in for rollouts: a number that depends on the weights."""
    return {"weight": float(next(policy.network.parameters()).sum()), "time_to_success_s": float("nan")}


def train(run: str, demos: list[Episode] | None = None, **changes: Any) -> Any:
    options: dict[str, Any] = {"run": run, "evaluate": evaluate, "progress": False, "seed": 3} | changes
    return options.pop("settings", SETTINGS).train(demos or demonstrations(12), POLICY, **options)


if __name__ == "__main__":
    train(sys.argv[1])
