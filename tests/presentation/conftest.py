"""What pages and films show: a recorded flight of an expert, and evaluations of the crane."""

from dataclasses import dataclass

import numpy as np
import pytest

import aerial_il
from aerial_il.data.episode import Episode
from aerial_il.evaluation.outcome import subtask_flags
from aerial_il.workflows.parts.pilots import record
from tests.evaluation.conftest import diver, expert

__all__ = ["Flown", "diver", "expert", "flown"]


@dataclass(frozen=True)
class Flown:
    """A recorded flight of an expert in the suite, and its sub-tasks (T, K)."""

    episode: Episode
    flags: np.ndarray


@pytest.fixture(scope="session")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    env = aerial_il.load_batch("ua_quad_arm4", "reach", num_envs=1, num_threads=1)
    file = tmp_path_factory.mktemp("flown") / "reach.mcap"
    episode = record(env, aerial_il.expert("ua_quad_arm4", "reach"), 1, file, name="expert")
    flags = subtask_flags(env, episode)
    env.close()
    return Flown(episode, flags)
