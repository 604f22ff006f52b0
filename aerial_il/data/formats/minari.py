"""Read Minari's datasets, the folder with ``data/main_data.hdf5`` and ``data/metadata.json``, from their files.

Observations of a vector, an image that is not compressed or a dictionary of these are read, one of them more than
actions; actions are vectors. The environment is the id that the metadata name, which is compared with lists and never
imported; where :mod:`aerial_il.data.formats.minari_export` wrote them, it is the recorded specification.

Source: Minari 0.5, ``HDF5Storage``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from aerial_il.core.bounded import parse_json, read_json
from aerial_il.core.errors import DemoError
from aerial_il.core.specs import UNKNOWN, EnvSpec
from aerial_il.data.episode import Episode
from aerial_il.data.formats.foreign import foreign_episode, foreign_spec
from aerial_il.data.formats.hdf5 import FAULTS, MAX_BYTES, array, child
from aerial_il.data.formats.hdf5_probe import require_readable
from aerial_il.data.formats.transitions import FIELD

FILE, METADATA = Path("data", "main_data.hdf5"), Path("data", "metadata.json")
SERIES = ("actions", "rewards", "terminations", "truncations")
SPEC, SUCCESS = "aerial_il_spec", "success"  # of ours, in the metadata and as an attribute of each episode
TUPLE = "_index_0"  # Minari's name for the first element of a tuple
JPEG = (0xFF, 0xD8, 0xFF)


@dataclass(frozen=True)
class _Told:
    """What the metadata say.

    Attributes:
        robot, task: ``gymnasium`` and an id, or unknown. spec: as recorded, None for files that are not ours.
    """

    robot: str
    task: str
    spec: EnvSpec | None = None


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
    told = _told(path)
    return {name: cache(lambda name=name: _read(path, name, (*bounds, longest), told)) for name in names}


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
        hint = "Actions of a Discrete or Tuple space cannot be imitated here."
        got = (actions.dtype, actions.shape)
        raise DemoError(path, "has actions that are not vectors of numbers.", got=got, hint=hint)
    return actions.astype(float)


def _check_size(path: Path, episode: h5py.Group) -> None:
    """Require that an episode can be held, before any of it is read."""
    groups = [(episode, name) for name in SERIES if name in episode]
    if isinstance(episode.get("observations"), h5py.Group):
        inner = child(path, episode, "observations", h5py.Group)
        groups += [(inner, str(name)) for name in inner]
    else:
        groups.append((episode, "observations"))
    size = sum(8 * int(_dataset(path, group, name).size or 0) for group, name in groups)
    if size > MAX_BYTES:
        problem = f"has an absurdly large episode {episode.name}."
        raise DemoError(path, problem, expected=f"at most {MAX_BYTES} bytes", got=size)


def _told(path: Path) -> _Told:
    """Return the recorded specification, or robot and task where an environment of Gymnasium's is named."""
    try:
        raw: Any = read_json(path / METADATA)
        if SPEC not in raw:
            return _Told("gymnasium", str(parse_json(raw["env_spec"])["id"]))
    except FAULTS:
        return _Told(UNKNOWN, UNKNOWN)
    try:
        spec = EnvSpec.from_dict(parse_json(raw[SPEC]))
    except FAULTS as error:
        raise DemoError(path / METADATA, f"has a malformed {SPEC} ({error}).") from error
    return _Told(spec.robot, spec.task, spec)


def _read(path: Path, name: str, seen: tuple[np.ndarray, np.ndarray, int], told: _Told) -> Episode:
    try:
        with h5py.File(path / FILE, "r") as file:
            return _episode(path, child(path, file, name, h5py.Group), seen, told)
    except DemoError:
        raise
    except FAULTS as error:
        raise DemoError(path, f"holds a malformed episode {name!r} ({error}).") from error


def _episode(path: Path, group: h5py.Group, seen: tuple[np.ndarray, np.ndarray, int], told: _Told) -> Episode:
    _check_size(path, group)
    actions, obs = _actions(path, group), _observations(path, group)
    if told.spec is not None and len(obs) == len(told.spec.observation.names) == 1:
        obs = dict(zip(told.spec.observation.names, obs.values(), strict=True))
    over = {name: array(path, group, name) for name in SERIES[1:]}
    if any(len(values) != len(actions) + 1 for values in obs.values()):
        lengths = {name: len(values) for name, values in obs.items()}
        raise DemoError(path, "has observations of another length.", expected=len(actions) + 1, got=lengths)
    *bounds, longest = seen
    own = foreign_spec(obs, (bounds[0], bounds[1]), max_steps=longest, robot=told.robot, task=told.task)
    if told.spec is not None:
        _check_fits(path, told.spec, own)
    return foreign_episode(
        str(group.name).strip("/"),
        told.spec or own,
        obs=obs,
        actions=actions,
        rewards=over["rewards"],
        success=bool(group.attrs.get(SUCCESS, True)),
        terminated=bool(over["terminations"][-1]),
        truncated=bool(over["truncations"][-1] and not over["terminations"][-1]),
        source=f"{path.name}, a Minari dataset",
    )


def _check_fits(path: Path, recorded: EnvSpec, own: EnvSpec) -> None:
    """Require that the recorded specification is of the arrays that are there."""
    sizes = [
        {**{field.name: field.shape for field in spec.observation.fields}, "actions": spec.action.low.shape}
        for spec in (recorded, own)
    ]
    if sizes[0] != sizes[1]:
        raise DemoError(path, f"has other arrays than its {SPEC} says.", expected=sizes[0], got=sizes[1])


def _observations(path: Path, group: h5py.Group) -> dict[str, np.ndarray]:
    """Return field -> (T + 1, ...), under the names that Gymnasium's environments are recorded with here."""
    if not isinstance(group.get("observations"), h5py.Group):
        return {FIELD: _field(path, group, "observations")}
    inner = child(path, group, "observations", h5py.Group)
    if TUPLE in inner:
        raise DemoError(path, "has observations of a Tuple space, which are not read: only vectors, images, Dict.")
    return {str(name): _field(path, inner, str(name)) for name in inner}


def _field(path: Path, group: h5py.Group, name: str) -> np.ndarray:
    """Return (T + 1, ...) numbers, or (T + 1, H, W, C) uint8 of an image."""
    dataset = _dataset(path, group, name)
    values = array(path, group, name) if dataset.dtype.kind != "O" else np.zeros((0, 0), np.uint8)
    jpeg = values.dtype == np.uint8 and values.ndim == 2 and values.shape[1] > 2 and (values[:, :3] == JPEG).all()
    if dataset.dtype.kind == "O" or jpeg:
        hint = "Write images with jpeg_encoding=False."
        raise DemoError(path, f"has texts or images as JPEG in {dataset.name}, which are not read.", hint=hint)
    if values.dtype == np.uint8 and values.ndim == 4:
        return values
    return values.astype(float) if values.ndim > 1 else values[:, None].astype(float)


def _dataset(path: Path, group: h5py.Group, name: str) -> h5py.Dataset:
    if isinstance(group.get(name, getlink=True), h5py.HardLink) and isinstance(group[name], h5py.Group):
        raise DemoError(path, f"has a Dict or Tuple of its own in {group.name}/{name}, which is not read.")
    return child(path, group, name, h5py.Dataset)
