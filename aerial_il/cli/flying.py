"""Who flies where: turn ``policy=...``, ``robot=...``, ``task=...`` into a policy and its environment."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import aerial_il
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.policy import Policy
from aerial_il.data.episode import Episode
from aerial_il.evaluation.baselines import BASELINES
from aerial_il.evaluation.judging import subtask_flags
from aerial_il.policies import load_policy

EXPERT = "expert"
DEFAULT_ACTION, DEFAULT_CONTROLLER = "ee_pose", "geometric_observer"
SEEDS_TRIED = 3


@dataclass(frozen=True)
class Pilot:
    """A policy with the cell and the action level that it flies."""

    policy: Policy
    robot: str
    task: str
    action: str
    words: str

    def environment(self, tier: str, *, num_envs: int, threads: int, controller: str = DEFAULT_CONTROLLER) -> Any:
        """Return a batch environment for it."""
        return aerial_il.load_batch(
            self.robot,
            self.task,
            num_envs=num_envs,
            tier=tier,
            action=self.action,
            num_threads=threads,
            controller=controller,
        )


def pilot(source: str, *, robot: str | None, task: str | None, action: str | None) -> Pilot:
    """Return the expert of a cell, a baseline, or a trained policy with what it was trained on where nothing is said.

    Args:
        source: ``expert``, ``random``, ``hover``, or the folder of a run or a policy.
        robot, task, action: registry names; None for the policy's own.
    """
    if source == EXPERT or source in BASELINES:
        if robot is None or task is None:
            raise InvalidValueError(f"policy={source} needs robot=... and task=... too. See: aerial-il list")
        policy = aerial_il.expert(robot, task) if source == EXPERT else BASELINES[source]()
        words = f"policy={source} robot={robot} task={task}" + (f" action={action}" if action else "")
        return Pilot(policy, robot, task, action or DEFAULT_ACTION, words)
    policy = load_policy(source)
    spec = policy.spec
    robot, task, action = robot or spec.robot, task or spec.task, action or spec.action.level
    return Pilot(policy, robot, task, action, f"policy={source} robot={robot} task={task} action={action}")


def record(env: Any, policy: Policy, seed: int, file: Path, *, name: str) -> Episode:
    """Fly one episode, keep its recording as ``file`` and return it.

    Args:
        env: a batch environment of one world. policy: what flies. seed: of the episode. name: who flies.
    """
    from aerial_il.collection.collect import collect
    from aerial_il.data.folder import KINDS
    from aerial_il.data.reader import read_episode

    with TemporaryDirectory() as folder:
        made = collect(env, policy, [seed], folder, policy_name=name, progress=False).folder
        (flown,) = (found for kind in KINDS for found in made.files(kind))
        file.parent.mkdir(parents=True, exist_ok=True)
        shutil.move(flown, file)
    return read_episode(file)


def expert_flight(robot: str, task: str) -> tuple[Episode, np.ndarray]:
    """Return the expert's flight of the first of a few seeds that it solves in calm air, and its sub-tasks (T, K)."""
    expert = pilot(EXPERT, robot=robot, task=task, action=None)
    env = expert.environment("calm", num_envs=1, threads=1)
    try:
        with TemporaryDirectory() as folder:
            flights = (
                record(env, expert.policy, seed, Path(folder) / f"{seed}.mcap", name=EXPERT)
                for seed in range(SEEDS_TRIED)
            )
            first = next(flights)
            episode = first if first.success else next((flight for flight in flights if flight.success), first)
        return episode, subtask_flags(env, episode)
    finally:
        env.close()
