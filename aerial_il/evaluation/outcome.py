"""Sub-tasks of a recorded flight, step by step: no recording holds them, because they follow from its states."""

import numpy as np

from aerial_il.data.episode import Episode
from aerial_il.suite.batch import BatchEnvironment


def subtask_flags(env: BatchEnvironment, episode: Episode) -> np.ndarray:
    """Return the sub-task flags (T, K) after each step of a flight.

    Args:
        env: a batch environment of the very scene that was recorded; its worlds are put into the recorded states.
        episode: a recording with states.
    """
    states, flags = episode.states[1:], []
    for first in range(0, len(states), env.num_envs):
        part = states[first : first + env.num_envs]
        env.set_state(np.resize(part, (env.num_envs, part.shape[1])))
        flags.append(env.simulation.reassess().subtasks[: len(part)])
    return np.concatenate(flags)
