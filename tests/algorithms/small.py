"""Small trainings on the mass of :mod:`tests.algorithms.drift`: settings of any algorithm, and a run of seed 1."""

from pathlib import Path
from typing import Any

from aerial_il import algorithms
from aerial_il.policies.categorical import Categorical
from aerial_il.policies.squashed_gaussian import SquashedGaussian
from tests.algorithms.made import made

POLICY = SquashedGaussian(hidden=(16,))
CHOICES = Categorical(hidden=(16,), choices="bounds")
SMALL: dict[str, Any] = {"warmup": 64, "batch_size": 32, "lr": 3e-3, "tau": 0.05, "critic_hidden": (16,)}
SMALL |= {"utd_ratio": 0.5, "actor_every": 1, "target_every": 1, "gamma": 0.9, "epochs": 4, "rollout": 80}
SMALL |= {"log_every": 80, "checkpoint_every": 0}


def short(name: str, **changes: Any) -> Any:
    """Return small settings of an algorithm, with those of the changes that it has."""
    return made(algorithms.get(name), {**SMALL, **changes})


def train(settings: Any, run: Path, env: Any, demos: Any = None, **options: Any) -> Any:
    """Train a small policy of a kind that the algorithm trains."""
    policy = POLICY if isinstance(POLICY, settings.trains) else CHOICES
    return settings.train(demos, policy, env=env, run=run, seed=1, progress=False, **options)
