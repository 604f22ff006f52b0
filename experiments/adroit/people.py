"""Demonstrations by people in virtual reality, as the authors of DAPG published them.

Source: A. Rajeswaran et al., "Learning Complex Dexterous Manipulation with Deep Reinforcement Learning and
Demonstrations", 2018, and its public data.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from aerial_il.core.bounded import read_npz
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec
from aerial_il.data.conversion import episode_of
from aerial_il.data.episode import Episode
from aerial_il.data.source import Raw
from experiments.adroit.tasks import AdroitTask

FIELD = "observation"


def file_of(task: AdroitTask, data: Path) -> Path:
    """Return the file of the task in the folder ``data``.

    Raises:
        InvalidValueError: the folder lacks it.
    """
    file = data / f"{task.name}_human_demos.npz"
    if not file.exists():
        raise InvalidValueError(f"{file} does not exist; say where people's demonstrations lie with bench.data=FOLDER.")
    return file


def flown_by_people(task: AdroitTask, data: Path, spec: EnvSpec) -> list[Episode]:
    """Return all that people flew, in the order of the file.

    Args:
        task: which. data: folder of ``TASK_human_demos.npz``. spec: of the environment that is learned in.

    Their actions are clipped to the environment's bounds, as the environment itself does; what followed the last action
    was not recorded, so that this action is left out. All are taken for successes, for they were meant to be imitated.
    """
    file = file_of(task, data)
    arrays, found = read_npz(file), []
    for name in sorted({name.partition("/")[0] for name in arrays}):
        actions = np.clip(arrays[f"{name}/actions"][:-1], spec.action.low, spec.action.high)
        raw = Raw(
            obs={FIELD: arrays[f"{name}/observations"]},
            actions=actions,
            rewards=arrays[f"{name}/rewards"][:-1],
            truncated=np.ones(len(actions), bool),
        )
        found.append(episode_of(f"{task.name}-people-{name}", raw, spec, note=f"read from {file.name}"))
    return found
