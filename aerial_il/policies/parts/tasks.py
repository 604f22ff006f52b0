"""One policy for several tasks of a robot: it sees the fields of all of them, and which task it is to do.

Demonstrations of several tasks are shown as if they came from one environment, whose observation has every field of
any of them, zero where a task has no such field, and ``task_id``, which is 1 at the task's place and 0 elsewhere. In
flight the environment says which task it is. Demonstrations that say in words what they do have ``instruction``
instead, and in flight the policy is told in words. All that it can be told is then the instruction of its
specification: a line for each wording, and behind a tab the instruction that it stands for and is shown as.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from aerial_il.core import language
from aerial_il.core.contracts import Observation
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec, Field, ObservationSpec
from aerial_il.data.episode import Episode
from aerial_il.policies.parts.language import sayings

TASK_ID, AND = "task_id", "+"
OWN = ("task", "observation", "max_steps", "instruction", "subtasks", "state_size")  # in what tasks may differ


def tasks_of(spec: EnvSpec) -> tuple[str, ...]:
    """Return the tasks that ``spec`` stands for, in the order of their places in ``task_id``."""
    if language.FIELD in spec.observation.names:
        return tuple(spec.task.split(AND))
    return spec.observation[TASK_ID].labels if TASK_ID in spec.observation.names else (spec.task,)


def united(specs: Sequence[EnvSpec]) -> EnvSpec:
    """Return the one environment that stands for those of several tasks.

    Raises:
        InvalidValueError: they differ in more than the task, or two fields of one name do.
    """
    first, fields = specs[0], dict[str, Field]()
    for spec in specs:
        if differing := first.differences(spec, ignore=(*OWN, "tier", "disturbances", "controller")):
            raise InvalidValueError(f"{first.task} and {spec.task} cannot be learned together: {'; '.join(differing)}.")
        for field in spec.observation.fields:
            if fields.setdefault(field.name, field) != field:
                raise InvalidValueError(f"{field.name!r} of {spec.task} is not that of the other tasks: {field}.")
    tasks = tuple(sorted({spec.task for spec in specs}))
    which = [] if language.FIELD in fields else [Field(TASK_ID, (len(tasks),), "task", labels=tasks, onboard=True)]
    return replace(
        first,
        task=AND.join(tasks),
        observation=ObservationSpec((*fields.values(), *which)),
        max_steps=max(spec.max_steps for spec in specs),
        instruction=" ".join(dict.fromkeys(spec.instruction for spec in specs)),
        subtasks=(),
        state_size=0,
    )


def unite(demos: Sequence[Episode]) -> list[Episode]:
    """Return demonstrations of one task as they are, and those of several as of one environment.

    Raises:
        InvalidValueError: those of one task, or of all, come from several environments.
    """
    if language.FIELD in demos[0].spec.observation.names:
        said = {text: meant for demo in demos for text, meant in sayings(demo).items()}
        wordings = "\n".join(f"{text}\t{meant}" for text, meant in said.items())
        demos = [replace(demo, spec=replace(demo.spec, instruction=wordings)) for demo in demos]
    specs = dict[str, EnvSpec]()
    for demo in demos:
        specs.setdefault(demo.spec.task, demo.spec)
    if len(specs) < 2:
        return list(demos)
    for demo in demos:
        if differing := specs[demo.spec.task].differences(demo.spec):
            raise InvalidValueError(f"Episode {demo.uid} comes from another environment: {'; '.join(differing)}.")
    spec = united(list(specs.values()))
    return [replace(d, spec=spec, obs=completed(d.obs, spec, d.spec.task)) for d in demos]


def wordings_of(spec: EnvSpec) -> dict[str, str]:
    """Return what a policy for ``spec`` can be told -> as what it is shown that; empty where these are not kept.

    Once they were not: there was one line, whatever had been learned from.
    """
    if language.FIELD not in spec.observation.names or "\t" not in spec.instruction:
        return {}
    return dict(line.split("\t", 1) for line in spec.instruction.splitlines())


def as_one_of(whole: EnvSpec, spec: EnvSpec) -> EnvSpec:
    """Return ``spec`` as :func:`completed` makes it look, where its task is one of several in ``whole``."""
    if spec.task not in tasks_of(whole):
        return spec
    shown, told = spec.observation.names, (TASK_ID, language.FIELD)
    blank = (field for field in whole.observation.fields if field.name not in shown and field.group != "image")
    added = tuple(field for field in blank if whole.task != spec.task or field.name in told)
    return replace(spec, task=whole.task, observation=ObservationSpec((*spec.observation.fields, *added)))


def completed(obs: Observation, spec: EnvSpec, task: str) -> dict[str, np.ndarray]:
    """Return ``obs`` (n, ...) of ``task`` with the fields of the other tasks, zero, and which task it is."""
    count = len(next(iter(obs.values())))
    missing = [f for f in spec.observation.fields if f.group != "image" and f.name not in (*obs, TASK_ID)]
    blank = {field.name: np.zeros((count, *field.shape)) for field in missing}
    if TASK_ID not in spec.observation.names:
        return {**obs, **blank}
    which = np.array([float(label == task) for label in tasks_of(spec)])
    return {**obs, **blank, TASK_ID: np.tile(which, (count, 1))}
