"""Train a policy on demonstrations; killed at any moment, the same command continues.

The run folder holds config.yaml, metrics.jsonl, tensorboard/, checkpoints/ and at the end policy/.

Example: aerial-il train dataset=datasets/pick policy=mlp algorithm=bc run=runs/pick_bc
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from aerial_il.cli.keys import MISSING, at_least, group, key, output


@dataclass
class Dataset:
    """Which demonstrations to learn from."""

    path: str = MISSING
    episodes: int | None = None


@dataclass
class Config:
    dataset: Dataset = group("folder of demonstrations, and how many of them (null: all)", path=True)
    policy: dict[str, Any] = group("what is trained")
    algorithm: dict[str, Any] = group("how it is trained")
    run: str = output(MISSING, "folder of the run")
    seed: int = key(0, "decides initial weights, validation split and minibatches")
    resume: bool = key(True, "continue what the run folder holds")
    progress: bool = key(True, "show a progress bar")

    def __post_init__(self) -> None:
        at_least(self, seed=0)


def run(config: Config) -> None:
    """Train, and say what comes next."""
    learn(config)
    print(f"Next: aerial-il evaluate policy={config.run} out={config.run}/evaluation")


def learn(config: Config) -> None:
    """Train, and say where the policy lies."""
    from aerial_il.cli import data
    from aerial_il.cli.build import build_all

    policy, algorithm = build_all(config.policy, config.algorithm)
    episodes = data.demonstrations(config.dataset.path, limit=config.dataset.episodes, images=policy.images)
    algorithm.train(episodes, policy, run=config.run, seed=config.seed, resume=config.resume, progress=config.progress)
    print(f"Policy: {config.run}/policy")
