"""The result of an evaluation, as an object and as ``evaluation.json``."""

from __future__ import annotations

import io
import os
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from aerial_il.core.bounded import read_json, read_npz
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import write_atomic, write_json
from aerial_il.evaluation.metrics import RETURN, EpisodeRecord, aggregate, proportion, spread
from aerial_il.evaluation.traces import Trace

SCHEMA = "aerial_il.evaluation/1"
FILE_NAME = "evaluation.json"
PATHS_NAME = "ee_paths.npz"
TRASH = "trash"  # where pruned runs are put, below the folder that was looked into
PATH_TOLERANCE_M = 0.002  # less than a pixel of a report


@dataclass(frozen=True, eq=False)
class Flight:
    """The data that show an episode again.

    Attributes:
        actions: (T, Da) commanded actions; with the seed they reproduce the episode bit for bit. None after loading
            from disk.
        ee_path: (P, 3) end effector in the world, m, without the points that lie within 2 mm of the straight
            line between those kept; empty where it is not observed.
        phase: (T,) phase index, -1 for policies without phases.
        phase_names: names of the phases.
    """

    ee_path: np.ndarray
    actions: np.ndarray | None = None
    phase: np.ndarray | None = None
    phase_names: tuple[str, ...] = ()

    @staticmethod
    def of(trace: Trace, phase_names: tuple[str, ...] = ()) -> Flight:
        path = trace.ee_pos[np.isfinite(trace.ee_pos).all(axis=1)]
        kept = simplified(path, PATH_TOLERANCE_M).astype(np.float32)
        return Flight(kept, trace.actions, trace.phase, tuple(phase_names))


def simplified(path: np.ndarray, tolerance: float) -> np.ndarray:
    """Return the points (P, 3) of a path (N, 3) that a polyline needs to stay within ``tolerance`` of all of them.

    Source:
        D. Douglas and T. Peucker, "Algorithms for the reduction of the number of points required to represent a
        digitized line or its caricature", Cartographica 1973.
    """
    kept = np.zeros(len(path), dtype=bool)
    kept[[0, -1] if len(path) else []] = True
    parts = [(0, len(path) - 1)]
    while parts:
        first, last = parts.pop()
        if last - first < 2:
            continue
        away = _distances(path[first + 1 : last], path[first], path[last])
        farthest = int(away.argmax())
        if away[farthest] > tolerance:
            middle = first + 1 + farthest
            kept[middle] = True
            parts += [(first, middle), (middle, last)]
    return path[kept]


def _distances(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return how far points (N, 3) lie from the straight line between ``a`` and ``b``."""
    along = b - a
    share = np.clip((points - a) @ along / max(float(along @ along), 1e-30), 0.0, 1.0)
    return np.linalg.norm(points - a - share[:, None] * along, axis=1)


@dataclass(frozen=True, eq=False)
class EvaluationResult:
    """One policy on one cell and tier over fixed seeds.

    Attributes:
        robot, task, tier: registry names.
        policy: name of what acted.
        episodes: one record per seed, in the order of the seeds.
        provenance: code, packages, machine, environment and whatever the caller added; plain values.
        flights: seed -> what is needed to show the episode again.
    """

    robot: str
    task: str
    tier: str
    policy: str
    episodes: tuple[EpisodeRecord, ...]
    provenance: Mapping[str, Any]
    flights: Mapping[int, Flight] = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        return f"EvaluationResult({self.policy}: {self.robot}/{self.task}, {self.tier}, {self.headline()})"

    @property
    def seeds(self) -> list[int]:
        return [episode.seed for episode in self.episodes]

    @cached_property
    def success(self) -> dict[str, Any]:
        """Count, rate and 95 % Wilson interval of the successes."""
        return proportion([episode.success for episode in self.episodes])

    @cached_property
    def metrics(self) -> dict[str, Any]:
        return aggregate(self.episodes)

    def headline(self) -> str:
        """The result in one line, e.g. ``198/200 = 99.0 % (95 % interval 96.4 to 99.7 %)``."""
        lo, hi = self.success["ci95"]
        count, rate, total = self.success["count"], self.success["rate"], len(self.episodes)
        return f"{count}/{total} = {100 * rate:.1f} % (95 % interval {100 * lo:.1f} to {100 * hi:.1f} %)"

    def return_line(self) -> str:
        """The mean return in one line, e.g. ``312.4 (95 % interval 290.1 to 330.0)``."""
        returns = spread(RETURN.key, map(RETURN.value, self.episodes))
        lo, hi = returns["ci95"]
        return f"{returns['mean']:.1f} (95 % interval {lo:.1f} to {hi:.1f})"

    def to_dict(self) -> dict[str, Any]:
        """Return the content of ``evaluation.json``."""
        return {
            "schema": SCHEMA,
            **{name: getattr(self, name) for name in ("robot", "task", "tier", "policy")},
            "episodes": len(self.episodes),
            "seeds": [self.seeds[0], self.seeds[-1]],
            "success": self.success,
            "return": spread(RETURN.key, map(RETURN.value, self.episodes)),
            "metrics": self.metrics,
            "per_episode": [episode.to_dict() for episode in self.episodes],
            "provenance": dict(self.provenance),
        }

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write ``evaluation.json`` and the simplified end-effector paths into ``folder``; return the JSON's path."""
        folder = Path(folder)
        buffer = io.BytesIO()
        paths: dict[str, Any] = {str(seed): flight.ee_path for seed, flight in self.flights.items()}
        np.savez_compressed(buffer, **paths)
        write_atomic(folder / PATHS_NAME, buffer.getvalue())
        return write_json(folder / FILE_NAME, self.to_dict())


def load_result(path: str | os.PathLike[str]) -> EvaluationResult:
    """Read a result back from ``evaluation.json`` or the folder that holds it.

    Raises:
        InvalidValueError: the file is missing, is not an evaluation of this schema, or contradicts itself.
    """
    path = Path(path)
    path = path / FILE_NAME if path.is_dir() else path
    raw = _read(path)
    try:
        episodes = tuple(EpisodeRecord.from_dict(entry) for entry in raw["per_episode"])
        head = {key: raw[key] for key in ("robot", "task", "tier", "policy", "provenance")}
        stated = raw["episodes"], raw["success"]["count"]
        _check_head(head)
    except (KeyError, TypeError, AttributeError) as error:
        raise InvalidValueError(f"{path}: not an evaluation: {error}.") from error
    if len({tuple(episode.subtasks) for episode in episodes}) > 1:
        raise InvalidValueError(f"{path}: its episodes have other sub-tasks than each other.")
    if repeated := sorted(seed for seed, times in Counter(e.seed for e in episodes).items() if times > 1):
        raise InvalidValueError(f"{path}: lists seed {repeated[0]} more than once; a seed is one flight.")
    listed = len(episodes), sum(episode.success for episode in episodes)
    if listed != stated:
        says = "{} episodes with {} successes"
        raise InvalidValueError(f"{path}: states {says.format(*stated)}, but lists {says.format(*listed)}.")
    return EvaluationResult(episodes=episodes, flights=_load_paths(path.with_name(PATHS_NAME)), **head)


def _check_head(head: Mapping[str, Any]) -> None:
    """Raise TypeError where what is said of all episodes has another type than an evaluation's."""
    origin = head["provenance"]
    texts = all(isinstance(head[key], str) for key in ("robot", "task", "tier", "policy"))
    inside = isinstance(origin, Mapping) and all(
        isinstance(origin.get(key, {}), Mapping) for key in ("environment", "trained")
    )
    if not (texts and inside):
        raise TypeError("robot, task, tier and policy are texts, provenance and what it tells of both are objects")


def find_results(folder: Path) -> Iterator[Path]:
    """Yield the folders that hold an evaluation, by name; the trash, links and hidden folders are not entered."""
    for place, inner, files in os.walk(folder):
        inner[:] = sorted(name for name in inner if name != TRASH and not name.startswith("."))
        if FILE_NAME in files:
            yield Path(place)


def _read(path: Path) -> dict[str, Any]:
    try:
        raw = read_json(path)
    except OSError as error:
        hint = "`aerial-il evaluate ... out=FOLDER` writes one."
        raise InvalidValueError(f"{path}: cannot be read ({error.strerror}). {hint}") from error
    except ValueError as error:
        raise InvalidValueError(f"{path}: is not valid JSON: {error}.") from error
    schema = raw.get("schema") if isinstance(raw, dict) else None
    if schema != SCHEMA:
        raise InvalidValueError(f"{path}: has schema {schema!r}; this version reads {SCHEMA!r}.")
    return raw


def _load_paths(path: Path) -> dict[int, Flight]:
    if not path.exists():
        return {}
    try:
        return {int(seed): Flight(values) for seed, values in read_npz(path).items()}
    except (OSError, ValueError) as error:
        raise InvalidValueError(f"{path}: cannot be read as paths of flights: {error}.") from error
