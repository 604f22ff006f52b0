"""The Adroit hand's tasks as others publish them: rewards, success, reference returns, demonstrators.

An episode flies 200 steps and succeeds with the goal held in more than 25 of them (DAPG). The normalised score is
100 · (return − random) / (expert − random) with D4RL's reference returns.

Sources: A. Rajeswaran et al., 2018 (DAPG), for the experts and the success; J. Fu et al., "D4RL: Datasets for Deep
Data-Driven Reinforcement Learning", 2020, file ``d4rl/infos.py``, for the reference returns.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aerial_il.core.contracts import StepResult
from aerial_il.core.env_wrapper import BatchEnvWrapper
from aerial_il.core.errors import InvalidValueError
from aerial_il.experts.outside.dapg import DapgExpert
from aerial_il.suite import outside

POLICIES = "dapg_policies.npz"
SUCCESS = "success:25"


@dataclass(frozen=True)
class AdroitTask:
    """One task.

    Attributes:
        name: of the task and its expert. env: Gymnasium id. random, expert: D4RL's reference returns.
        apart: columns of the observation from palm to handle or object; the published reward falls with their length.
    """

    name: str
    env: str
    random: float
    expert: float
    apart: slice

    def score(self, returns: np.ndarray) -> np.ndarray:
        """Return normalised scores for returns of any shape."""
        return 100.0 * (returns - self.random) / (self.expert - self.random)


TASKS = {
    task.name: task
    for task in (
        AdroitTask("door", "AdroitHandDoor-v1", -56.512833, 2880.5693087298737, slice(35, 38)),
        AdroitTask("relocate", "AdroitHandRelocate-v1", -6.425911, 4233.877797728884, slice(30, 33)),
    )
}


class PublishedRewards(BatchEnvWrapper):
    """An Adroit batch environment that gives the rewards of the published returns.

    The v1 environments of gymnasium-robotics add 0.1 times the distance from palm to handle or object, which the
    published ones subtract: a hand that stays away is paid for it. Twice that term is taken off again. All else is
    their own.

    Sources: ``adroit_door.py`` and ``adroit_relocate.py`` of gymnasium-robotics 1.4.2 against ``door_v0.py`` and
    ``relocate_v0.py`` of D4RL's ``hand_manipulation_suite``.

    Args:
        task: which. num_envs: worlds. max_steps: of an episode; None for the environment's own 200.

    Attributes:
        own_returns: seed -> sum of the environment's own rewards so far.
    """

    def __init__(self, task: AdroitTask, num_envs: int, max_steps: int | None = None) -> None:
        super().__init__(outside.load_gymnasium(task.env, num_envs=num_envs, success=SUCCESS, max_steps=max_steps))
        self.task = task
        self.own_returns: dict[int, float] = {}

    def reset(self, seeds: np.ndarray | int, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        obs = self.env.reset(seeds, mask)
        started = self.env.seeds if mask is None else self.env.seeds[mask]
        self.own_returns.update(dict.fromkeys(started.tolist(), 0.0))
        return obs

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        result = self.env.step(actions, mask)
        for world in range(self.env.num_envs) if mask is None else np.flatnonzero(mask):
            self.own_returns[int(self.env.seeds[world])] += float(result.reward[world])
        apart = result.obs["observation"][:, self.task.apart]
        reward = result.reward - 0.2 * np.sqrt((apart**2).sum(axis=1))
        return StepResult(result.obs, reward, result.terminated, result.truncated, result.info)


def expert_of(task: AdroitTask, data: Path, *, noise: float) -> DapgExpert:
    """Return the task's expert from the folder ``data``.

    Raises:
        InvalidValueError: the folder lacks it.
    """
    file = data / POLICIES
    if not file.exists():
        raise InvalidValueError(f"{file} does not exist; say where the experts of DAPG lie with bench.data=FOLDER.")
    return DapgExpert.load(file, task.name, noise=noise)
