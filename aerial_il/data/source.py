"""What the file of a format hands over: demonstrations as they were found, renamed and never mended.

:mod:`aerial_il.data.check` judges them, and :mod:`aerial_il.data.survey` says what came of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.specs import UNKNOWN, EnvSpec, Group
from aerial_il.data.episode import Episode
from aerial_il.data.reading import Reading

Cameras = bool | Sequence[str]
RETURN = "return:R"  # R: a number
SUCCESSES = ("all", "reward", RETURN, "terminal", "survived")
MEGABYTE = 1 << 20


@dataclass(frozen=True, kw_only=True)
class Wanted(Reading):
    """What of a dataset is asked for, and answers to what its format cannot say; see :func:`.dataset.open_dataset`.

    Raises:
        InvalidValueError: an answer is none.
    """

    cameras: Cameras = False
    failures: bool = False
    states: bool = True

    def __post_init__(self) -> None:
        if self.control_dt is not None and not 0 < self.control_dt < math.inf:
            raise InvalidValueError(f"control_dt={self.control_dt} must be a positive number of seconds.")
        if self.memory_mb < 1:
            raise InvalidValueError(f"memory_mb={self.memory_mb} must be at least 1.")
        said = {*SUCCESSES} - {RETURN}
        if self.success is not None and self.least_return is None and self.success not in said:
            raise InvalidValueError(f"success={self.success} is not one of {', '.join(SUCCESSES)}.")

    @property
    def least_return(self) -> float | None:
        """The return that is a success, where ``success=return:R`` says so."""
        name, _, least = (self.success or "").partition(":")
        try:
            number = float(least) if name == "return" else math.nan
        except ValueError:
            return None
        return number if math.isfinite(number) else None

    @property
    def answered(self) -> str:
        """The keys that answer what a recording of ours says itself."""
        return ", ".join(f"{n}=" for n in ("success", "control_dt", "terminals") if getattr(self, n) is not None)

    def sees(self, image: str) -> bool:
        """Whether an image field is to be read."""
        return self.cameras if isinstance(self.cameras, bool) else image in self.cameras


@dataclass(frozen=True)
class Later:
    """An array that is read when it is used, such as pictures; what it will be is known before.

    Attributes:
        shape, dtype: of the array. load: returns some of the rows that the file has. first: the first one of these.
    """

    shape: tuple[int, ...]
    dtype: np.dtype
    load: Callable[[slice], np.ndarray]
    first: int = 0

    def __len__(self) -> int:
        return self.shape[0]

    @property
    def nbytes(self) -> int:
        return math.prod(self.shape) * self.dtype.itemsize

    def __getitem__(self, rows: slice | np.ndarray) -> Later:
        """Return some of the rows, to be read later, too; a slice has no step."""
        if isinstance(rows, slice):
            first, last, _ = rows.indices(len(self))
            return replace(self, shape=(max(last - first, 0), *self.shape[1:]), first=self.first + first)
        return Later((len(rows), *self.shape[1:]), self.dtype, lambda part: self.read()[rows][part])

    def __array__(self, dtype: np.typing.DTypeLike = None, copy: bool | None = None) -> np.ndarray:
        return np.asarray(self.read(), dtype)

    def read(self) -> np.ndarray:
        return self.load(slice(self.first, self.first + len(self)))


Rows = np.ndarray | Later


@dataclass(frozen=True, kw_only=True, eq=False)
class Raw:
    """One demonstration of T steps as a file holds it. None stands for what the file does not say.

    Attributes:
        obs: field -> (T, ...) or (T + 1, ...); pictures are told by their shape. actions: (T, Da).
        next_obs: field -> (T, ...) what was seen after each action.
        rewards: (T,).
        terminated, truncated: (T,) the environment ended the episode, or time was up.
        done: (T,) an end of which the format does not say what it means.
        success: whether the task was solved.
        frames, times: (T,) the number of each row, and when it was taken (s).
        steps: T, where the file says it beside the rows.
        states: (T, S) or (T + 1, S) of a simulator. model_xml: its scene.
        provenance: what is known of the flight.
    """

    obs: Mapping[str, Rows]
    actions: Rows
    next_obs: Mapping[str, Rows] = field(default_factory=dict)
    rewards: Rows | None = None
    terminated: Rows | None = None
    truncated: Rows | None = None
    done: Rows | None = None
    success: bool | None = None
    frames: Rows | None = None
    times: Rows | None = None
    steps: int | None = None
    states: Rows | None = None
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
        control_dt_s, robot, task, instruction: what is known without a ``spec``; ``gymnasium`` and an id name such an
            environment.
        labels: field, or ``action`` -> names of its elements. groups: field -> its group, ``proprio`` where none is.
        filters: name -> uids of a part of the dataset that it names, for ``filter_key=``.
        unread: what it holds and is not read, in words.
        borders: False for one that holds transitions of many episodes, to be cut where one ended.
        files: uid -> the file of a recorded episode, where each has one of its own.
        parts: the datasets that it is put together from.
    """

    path: Path
    kind: str
    raw: Mapping[str, Callable[[], Raw]] = field(default_factory=dict)
    recorded: Mapping[str, Callable[[], Episode]] = field(default_factory=dict)
    spec: EnvSpec | None = None
    control_dt_s: float | None = None
    robot: str = UNKNOWN
    task: str = UNKNOWN
    instruction: str = ""
    labels: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    groups: Mapping[str, Group] = field(default_factory=dict)
    filters: Mapping[str, Sequence[str]] = field(default_factory=dict)
    unread: Sequence[str] = ()
    borders: bool = True
    files: Mapping[str, Path] = field(default_factory=dict)
    parts: Sequence[Source] = ()

    def part(self, filter_key: str | None) -> Source:
        """Return the part of the dataset that it names so, or all of it for None.

        Raises:
            InvalidValueError, UnknownNameError: it names no parts, or none of that name.
        """
        if filter_key is None:
            return self
        if not self.filters:
            raise InvalidValueError(f"{self.path} names no parts of itself: leave out filter_key={filter_key}.")
        if filter_key not in self.filters:
            raise UnknownNameError("filter_key", filter_key, sorted(self.filters))
        kept = {*self.filters[filter_key]}
        raw = {uid: read for uid, read in self.raw.items() if uid in kept}
        return replace(self, raw=raw, recorded={uid: read for uid, read in self.recorded.items() if uid in kept})
