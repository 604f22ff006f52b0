"""What the file of a format hands over: demonstrations as they were found, renamed and never mended.

:mod:`aerial_il.data.check` judges them and makes episodes of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from aerial_il.core.specs import UNKNOWN, EnvSpec
from aerial_il.data.episode import Episode

Cameras = bool | Sequence[str]


@dataclass(frozen=True, kw_only=True)
class Wanted:
    """What of a dataset is asked for; a format that has nothing of the kind passes over it.

    Attributes:
        cameras: True to decode all image fields, or the names of some.
        failures: also the failed episodes that lie apart from the others.
        states: the simulator's states, which are most of a recording and which no training looks at.
    """

    cameras: Cameras = False
    failures: bool = False
    states: bool = True


@dataclass(frozen=True)
class Later:
    """An array that is read when it is used, such as pictures; what it will be is known before.

    Attributes:
        shape, dtype: of the array. read: returns it.
    """

    shape: tuple[int, ...]
    dtype: np.dtype
    read: Callable[[], np.ndarray]


@dataclass(frozen=True, kw_only=True, eq=False)
class Raw:
    """One demonstration of T steps as a file holds it. None stands for what the file does not say.

    Attributes:
        obs: field -> (T, ...) or (T + 1, ...); uint8 (T, H, W, C) are images. actions: (T, Da).
        next_obs: field -> (T, ...) what was seen after each action, of transitions alone.
        rewards, terminated, truncated: (T,). success: whether the task was solved.
        states: (T, S) or (T + 1, S) of a simulator. model_xml: its scene.
        provenance: what is known of the flight.
    """

    obs: Mapping[str, np.ndarray | Later]
    actions: np.ndarray
    next_obs: Mapping[str, np.ndarray] | None = None
    rewards: np.ndarray | None = None
    terminated: np.ndarray | None = None
    truncated: np.ndarray | None = None
    success: bool | None = None
    states: np.ndarray | None = None
    model_xml: str = ""
    provenance: Mapping[str, object] = field(default_factory=lambda: {"policy": UNKNOWN})


@dataclass(frozen=True, kw_only=True, eq=False)
class Source:
    """A dataset as its format reads it.

    Attributes:
        path: where it lies. kind: what it is, e.g. ``a robomimic file``.
        raw: uid -> function that reads the demonstration.
        recorded: uid -> function that reads the episode, where we have recorded it with all that an episode has.
        spec: of the raw ones, where the dataset says it; otherwise it is read off all of them.
        control_dt_s, robot, task: what is known without a ``spec``; ``gymnasium`` and an id name such an environment.
        borders: False for one that holds transitions of many episodes, to be cut where one ended.
        files: uid -> the file of a recorded episode, where each has one of its own.
        parts: the datasets that it is put together from.
    """

    path: Path
    kind: str
    raw: Mapping[str, Callable[[], Raw]] = field(default_factory=dict)
    recorded: Mapping[str, Callable[[], Episode]] = field(default_factory=dict)
    spec: EnvSpec | None = None
    control_dt_s: float = 1.0
    robot: str = UNKNOWN
    task: str = UNKNOWN
    borders: bool = True
    files: Mapping[str, Path] = field(default_factory=dict)
    parts: Sequence[Source] = ()
