"""Demonstrations that say in words what they do: an observation ``instruction`` instead of the number of a task."""

from dataclasses import replace
from zlib import crc32

import numpy as np

from aerial_il.core import language
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec, Field, ObservationSpec
from aerial_il.data.episode import Episode
from aerial_il.data.provenance import INSTRUCTION

MEANING = "what the robot is told, a hashed bag of words"
TOLD = Field(language.FIELD, (language.SIZE,), "task", meaning=MEANING, noise="exact: the user gives it", onboard=True)


def in_words(episode: Episode) -> Episode:
    """Return the episode with its instruction as an observation.

    Where the instruction is the suite's own, the episode takes one of the task's wordings, by its name: so a dataset
    has them all, but for those that are held out, see :attr:`aerial_il.suite.tasks.task.Task.wordings`.

    Raises:
        InvalidValueError: neither the episode nor its dataset says what is done.
    """
    text = episode.instruction if INSTRUCTION in episode.provenance else _worded(episode.spec, episode.uid)
    if not language.tokens(text):
        raise InvalidValueError(
            f"Episode {episode.uid} has no instruction to learn from with dataset.language=true: give it one, "
            f"aerial-il relabel DATASET where=\"task == '{episode.spec.task}'\" instruction='...'"
        )
    seen = np.tile(language.embedded(text), (len(next(iter(episode.obs.values()))), 1))
    spec = replace(episode.spec, observation=ObservationSpec((*episode.spec.observation.fields, TOLD)))
    provenance = {**episode.provenance, INSTRUCTION: text}
    return replace(episode, spec=spec, obs={**episode.obs, language.FIELD: seen}, provenance=provenance)


def _worded(spec: EnvSpec, uid: str) -> str:
    from aerial_il.suite import tasks

    if spec.is_outside or spec.task not in tasks.names():
        return spec.instruction
    task = tasks.get(spec.task)
    known = (task.instruction, *task.wordings)
    return known[crc32(uid.encode()) % len(known)] if spec.instruction == task.instruction else spec.instruction
