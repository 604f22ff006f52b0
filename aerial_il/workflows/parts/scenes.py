"""The very scene of a recording, to ask the suite about its states."""

from __future__ import annotations

import numpy as np

from aerial_il.core.errors import AerialError
from aerial_il.data.episode import Episode
from aerial_il.evaluation.outcome import subtask_flags
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.scenario import Scenario

WORLDS = 64


def same_scene(episode: Episode, num_envs: int = 1) -> BatchEnvironment | None:
    """Return an environment in the very scene of a recording, or None if there is none any more."""
    spec = episode.spec
    try:
        scenario = Scenario(spec.robot, spec.task, spec.tier, spec.action.level, controller=spec.controller)
        env = BatchEnvironment(scenario, num_envs)
        env.reset(0)
    except AerialError:
        return None
    if env.model_xml == episode.model_xml and env.spec.state_size == spec.state_size:
        return env
    env.close()
    return None


class SubtaskJudge:
    """Says the sub-tasks of recordings, step by step; it keeps the last scene, for the next recording of it."""

    def __init__(self) -> None:
        self._env: BatchEnvironment | None = None
        self._of: tuple[object, ...] = ()

    def __enter__(self) -> SubtaskJudge:
        return self

    def __exit__(self, *_: object) -> None:
        if self._env is not None:
            self._env.close()

    def __call__(self, episode: Episode) -> np.ndarray | None:
        """Return flags (T, K), or None where the suite does not build the scene (any more)."""
        spec = episode.spec
        scene = (spec.robot, spec.task, spec.tier, spec.action.level, spec.controller, episode.model_xml)
        if scene != self._of:
            self.__exit__()
            self._env, self._of = same_scene(episode, WORLDS), scene
        return None if self._env is None else subtask_flags(self._env, episode)
