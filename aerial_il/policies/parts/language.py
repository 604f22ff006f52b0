"""Demonstrations that say in words what they do: an observation ``instruction`` instead of the number of a task."""

from dataclasses import replace

import numpy as np

from aerial_il.core import language
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import Field, ObservationSpec
from aerial_il.data.episode import Episode

MEANING = "what the robot is told, a hashed bag of words"
TOLD = Field(language.FIELD, (language.SIZE,), "task", meaning=MEANING, noise="exact: the user gives it", onboard=True)


def in_words(episode: Episode) -> Episode:
    """Return the episode with its instruction as an observation.

    Raises:
        InvalidValueError: neither the episode nor its dataset says what is done.
    """
    text = episode.instruction
    if not language.tokens(text):
        raise InvalidValueError(
            f"Episode {episode.uid} has no instruction to learn from with dataset.language=true: give it one, "
            f"aerial-il relabel DATASET where=\"task == '{episode.spec.task}'\" instruction='...'"
        )
    seen = np.tile(language.embedded(text), (len(next(iter(episode.obs.values()))), 1))
    spec = replace(episode.spec, observation=ObservationSpec((*episode.spec.observation.fields, TOLD)))
    return replace(episode, spec=spec, obs={**episode.obs, language.FIELD: seen})


def sayings(episode: Episode) -> dict[str, str]:
    """Return all that may be said for the instruction of an episode -> that instruction, each on one line.

    Where it is the suite's own these are the wordings of its task, but for those that are held out, see
    :attr:`aerial_il.suite.tasks.task.Task.wordings`.
    """
    from aerial_il.suite import tasks

    spec, text = episode.spec, " ".join(episode.instruction.split())
    known = tasks.get(spec.task) if not spec.is_outside and spec.task in tasks.names() else None
    own = known.wordings if known and text == known.instruction else ()
    return dict.fromkeys((text, *own), text)
