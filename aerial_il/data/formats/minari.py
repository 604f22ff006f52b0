"""Read Minari's datasets, the folder with ``data/main_data.hdf5`` and ``data/metadata.json``, from their files.

Observations of a vector or a dictionary of vectors are read, one of them more than actions; actions are vectors. The
environment is the id that the metadata name, which is compared with lists and never imported.

Source: Minari 0.5, ``HDF5Storage``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from aerial_il.core.bounded import parse_json, read_json
from aerial_il.core.errors import DemoError
from aerial_il.core.specs import UNKNOWN
from aerial_il.data.episode import Episode
from aerial_il.data.formats.foreign import foreign_episode, foreign_spec
from aerial_il.data.formats.hdf5 import FAULTS, MAX_BYTES, array, child
from aerial_il.data.formats.hdf5_probe import require_readable
from aerial_il.data.formats.transitions import FIELD

FILE, METADATA = Path("data", "main_data.hdf5"), Path("data", "metadata.json")
SERIES = ("actions", "rewards", "terminations", "truncations")


def open_minari(path: Path) -> dict[str, Callable[[], Episode]]:
    """Return uid -> function that reads the episode.

    Raises:
        DemoError: it is no such dataset, holds other than numbers, or refers to data outside itself.
    """
    require_readable(path / FILE)
    try:
        with h5py.File(path / FILE, "r") as file:
            names = sorted((n for n in map(str, file) if n.startswith("episode_")), key=lambda n: (len(n), n))
            bounds, longest = _survey(path, file, names)
    except DemoError:
        raise
    except FAULTS as error:
        raise DemoError(path, f"cannot be read as a Minari dataset ({error}).") from error
    told = {"max_steps": longest, **_environment(path)}
    return {name: cache(lambda name=name: _read(path, name, bounds, told)) for name in names}


def _survey(path: Path, file: h5py.File, names: Sequence[str]) -> tuple[tuple[np.ndarray, np.ndarray], int]:
    """Return least and greatest action (Da,) of all episodes, and the length of the longest."""
    lows, highs, longest = [], [], 0
    for name in names:
        episode = child(path, file, name, h5py.Group)
        _check_size(path, episode)
        actions = _actions(path, episode)
        lows.append(actions.min(0))
        highs.append(actions.max(0))
        longest = max(longest, len(actions))
    if not names:
        raise DemoError(path, "holds no demonstrations.")
    return (np.min(lows, 0), np.max(highs, 0)), longest


def _actions(path: Path, episode: h5py.Group) -> np.ndarray:
    actions = array(path, episode, "actions")
    if actions.ndim != 2 or actions.dtype.kind != "f" or not actions.size:
        raise DemoError(path, "has actions that are not vectors of numbers.", got=(actions.dtype, actions.shape))
    return actions.astype(float)


def _check_size(path: Path, episode: h5py.Group) -> None:
    """Require that an episode can be held, before any of it is read."""
    groups = [(episode, name) for name in SERIES if name in episode]
    if isinstance(episode.get("observations"), h5py.Group):
        inner = child(path, episode, "observations", h5py.Group)
        groups += [(inner, str(name)) for name in inner]
    else:
        groups.append((episode, "observations"))
    size = sum(8 * child(path, group, name, h5py.Dataset).size for group, name in groups)
    if size > MAX_BYTES:
        problem = f"has an absurdly large episode {episode.name}."
        raise DemoError(path, problem, expected=f"at most {MAX_BYTES} bytes", got=size)


def _environment(path: Path) -> dict[str, str]:
    """Return robot and task where the metadata name an environment of Gymnasium's."""
    try:
        told = read_json(path / METADATA)
        spec: Any = parse_json(told["env_spec"])
        return {"robot": "gymnasium", "task": str(spec["id"])}
    except FAULTS:
        return {"robot": UNKNOWN, "task": UNKNOWN}


def _read(path: Path, name: str, bounds: tuple[np.ndarray, np.ndarray], told: Mapping[str, Any]) -> Episode:
    try:
        with h5py.File(path / FILE, "r") as file:
            return _episode(path, child(path, file, name, h5py.Group), bounds, told)
    except DemoError:
        raise
    except FAULTS as error:
        raise DemoError(path, f"holds a malformed episode {name!r} ({error}).") from error


def _episode(path: Path, group: h5py.Group, bounds: tuple[np.ndarray, np.ndarray], told: Mapping[str, Any]) -> Episode:
    _check_size(path, group)
    actions, obs = _actions(path, group), _observations(path, group)
    over = {name: array(path, group, name) for name in SERIES[1:]}
    if any(len(values) != len(actions) + 1 for values in obs.values()):
        lengths = {name: len(values) for name, values in obs.items()}
        raise DemoError(path, "has observations of another length.", expected=len(actions) + 1, got=lengths)
    return foreign_episode(
        str(group.name).strip("/"),
        foreign_spec(obs, bounds, **told),
        obs=obs,
        actions=actions,
        rewards=over["rewards"],
        terminated=bool(over["terminations"][-1]),
        truncated=bool(over["truncations"][-1] and not over["terminations"][-1]),
        source=f"{path.name}, a Minari dataset",
    )


def _observations(path: Path, group: h5py.Group) -> dict[str, np.ndarray]:
    """Return field -> (T + 1, ...), under the names that Gymnasium's environments are recorded with here."""
    if not isinstance(group.get("observations"), h5py.Group):
        return {FIELD: array(path, group, "observations").astype(float)}
    inner = child(path, group, "observations", h5py.Group)
    return {str(name): array(path, inner, str(name)).astype(float) for name in inner}
