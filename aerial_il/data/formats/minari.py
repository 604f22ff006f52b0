"""Minari's datasets, the folder with ``data/main_data.hdf5`` and ``data/metadata.json``, read and written as files.

Observations of a vector, an image that is not compressed or a dictionary of these are read, one of them more than
actions; actions are vectors. The environment is the id that the metadata name, which is compared with lists and never
imported. What is written keeps the recorded specification, under ``aerial_il_spec`` in the metadata, and pictures as
they are, without JPEG.

Source: Minari 0.5, ``HDF5Storage`` and ``serialize_space``.
"""

import json
import re
from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from aerial_il.core.bounded import parse_json, read_json
from aerial_il.core.errors import DemoError, InvalidValueError
from aerial_il.core.specs import UNKNOWN, EnvSpec
from aerial_il.data.episode import Episode
from aerial_il.data.formats.parts.hdf5 import FAULTS, child, later, numbered, opened
from aerial_il.data.formats.parts.transitions import FIELD
from aerial_il.data.formats.parts.whole import replacing, require_room
from aerial_il.data.source import Later, Raw, Source, Wanted

ENDINGS, OWN_NAME = ("",), "minari/flights-v0"
PARTS = ("data/*",)
FILE, METADATA = Path("data", "main_data.hdf5"), Path("data", "metadata.json")
SERIES = ("actions", "rewards", "terminations", "truncations")
SPEC, SUCCESS = "aerial_il_spec", "success"  # of ours, in the metadata and as an attribute of each episode
TUPLE = "_index_0"  # Minari's name for the first element of a tuple
JPEG = (0xFF, 0xD8, 0xFF)
VERSION = "0.5.4"  # of Minari, whose layout is written; its readers check it
NAME = re.compile(r"[-_\w]+-v\d+")


def recognises(path: Path) -> bool:
    return (path / FILE).is_file()


def read(path: Path, wanted: Wanted) -> Source:
    with opened(path / FILE, "cannot be read as a Minari dataset") as file:
        names = numbered(name for name in map(str, file) if name.startswith("episode_"))
    robot, task, spec = _environment(path)
    raw = {name: partial(_raw, path, name, spec) for name in names}
    return Source(path=path, kind="a Minari dataset", raw=raw, spec=spec, robot=robot, task=task)


def write(episodes: Iterable[Episode], out: Path, *, env_spec: str | None = None) -> Path:
    """Write episodes of one environment as one dataset; their actions are the labels to be learned.

    Args:
        episodes: of one environment.
        out: its folder, NAME-vN, which is the name that Minari knows it by; one that is there is replaced.
        env_spec: Gymnasium's specification of the environment, as JSON.

    Raises:
        InvalidValueError: the name is none of Minari's, or ``out`` holds something else.
    """
    if not NAME.fullmatch(out.name):
        raise InvalidValueError(
            f"out={out}: a dataset of Minari's is named NAME-vN, e.g. {out.with_name('flights-v0')}."
        )
    if out.exists() and not (out / METADATA).is_file():
        raise InvalidValueError(f"out={out} is there and holds no dataset of Minari's: choose another name.")
    episodes = iter(episodes)
    first = next(episodes)
    with replacing(out) as temporary:
        (temporary / FILE).parent.mkdir(parents=True)
        with h5py.File(temporary / FILE, "w", track_order=True) as file:
            lengths = []
            for number, episode in enumerate(chain([first], episodes)):
                require_room(temporary, 2 * episode.nbytes)
                lengths.append(_write(file, number, episode))
        size_mb = round((temporary / FILE).stat().st_size / 1e6, 1)
        told = {**_metadata(first, lengths, out.name), "dataset_size": size_mb}
        told |= {"env_spec": env_spec} if env_spec else {}
        (temporary / METADATA).write_text(json.dumps(told))
    return out


def _raw(path: Path, name: str, spec: EnvSpec | None) -> Raw:
    with opened(path / FILE, f"holds a malformed episode {name!r}") as file:
        group = child(path, file, name, h5py.Group)
        obs = {name: _field(path, *place) for name, place in _observed(path, group)}
        if spec is not None and len(obs) == len(spec.observation.names) == 1:
            obs = dict(zip(spec.observation.names, obs.values(), strict=True))
        actions, rewards, terminated, truncated = (later(path, group, name) for name in SERIES)
        success = bool(group.attrs[SUCCESS]) if SUCCESS in group.attrs else None
        return Raw(
            obs=obs,
            actions=actions,
            rewards=rewards,
            terminated=None if spec and success and not spec.is_outside else terminated,  # a success ended it
            truncated=truncated,
            success=success,
            steps=int(group.attrs["total_steps"]) if "total_steps" in group.attrs else None,
        )


def _environment(path: Path) -> tuple[str, str, EnvSpec | None]:
    """Return robot, task and the recorded specification; without it an environment of Gymnasium's, if one is named."""
    try:
        raw: Any = read_json(path / METADATA)
        if SPEC not in raw:
            return "gymnasium", str(parse_json(raw["env_spec"])["id"]), None
    except FAULTS:
        return UNKNOWN, UNKNOWN, None
    try:
        spec = EnvSpec.from_dict(parse_json(raw[SPEC]))
    except FAULTS as error:
        raise DemoError(path / METADATA, f"has a malformed {SPEC} ({error}).") from error
    return spec.robot, spec.task, spec


def _observed(path: Path, group: h5py.Group) -> Iterator[tuple[str, tuple[h5py.Group, str]]]:
    """Yield each field, and where it lies, under the name that Gymnasium's environments are recorded with here."""
    if not isinstance(group.get("observations", getlink=True), h5py.HardLink) or isinstance(
        group["observations"], h5py.Dataset
    ):
        child(path, group, "observations", h5py.Dataset)
        yield FIELD, (group, "observations")
        return
    inner = child(path, group, "observations", h5py.Group)
    if TUPLE in inner:
        raise DemoError(path, "has observations of a Tuple space, which are not read: only vectors, images, Dict.")
    for name in map(str, inner):
        if isinstance(inner.get(name, getlink=True), h5py.HardLink) and isinstance(inner[name], h5py.Group):
            raise DemoError(path, f"has a Dict or Tuple of its own in {inner.name}/{name}, which is not read.")
        child(path, inner, name, h5py.Dataset)
        yield name, (inner, name)


def _field(path: Path, group: h5py.Group, name: str) -> Later:
    """Return (T + 1, ...) numbers, or pictures."""
    held: h5py.Dataset = child(path, group, name, h5py.Dataset)
    packed = held.dtype == np.uint8 and held.ndim == 2 and held.shape[0] and held.shape[1] > 2
    if held.dtype.kind == "O" or (packed and (np.asarray(held[:1, :3]) == JPEG).all()):
        hint = "Write images with jpeg_encoding=False."
        raise DemoError(path, f"has texts or images as JPEG in {group.name}/{name}, which are not read.", hint=hint)
    return later(path, group, name)


def _write(file: h5py.File, number: int, episode: Episode) -> int:
    """Write an episode and return its length."""
    group = file.create_group(f"episode_{number}")
    group.attrs.update({"id": number, "total_steps": len(episode), "uid": episode.uid})
    group.attrs[SUCCESS] = episode.success
    over = np.arange(len(episode)) == len(episode) - 1
    ended = over & episode.is_terminal
    columns = (episode.labels, episode.rewards, ended, over & ~ended)
    observed = {f"observations/{name}": values for name, values in episode.obs.items()}
    if len(observed) == 1:
        observed = {"observations": next(iter(observed.values()))}
    for name, values in {**dict(zip(SERIES, columns, strict=True)), **observed}.items():
        group.create_dataset(name, data=values, chunks=True, maxshape=(None, *values.shape[1:]))
    return len(episode)


def _metadata(first: Episode, lengths: list[int], name: str) -> dict[str, Any]:
    spec = first.spec
    boxes = {field.name: _box(first.obs[field.name]) for field in spec.observation.fields if field.name in first.obs}
    observed = next(iter(boxes.values())) if len(boxes) == 1 else {"type": "Dict", "subspaces": boxes}
    action = {
        "type": "Box", "dtype": "float64", "shape": list(spec.action.low.shape),
        "low": spec.action.low.tolist(), "high": spec.action.high.tolist(),
    }  # fmt: skip
    return {
        "dataset_id": name,
        "minari_version": VERSION,
        "data_format": "hdf5",
        "jpeg_encoding": False,
        "total_episodes": len(lengths),
        "total_steps": sum(lengths),
        "observation_space": json.dumps(observed),
        "action_space": json.dumps(action),
        "description": f"{spec.task} on {spec.robot}, tier {spec.tier}, converted by aerial_il.",
        "algorithm_name": str(first.provenance.get("policy", "")),
        SPEC: json.dumps(_recorded(spec, boxes).to_dict()),
    }


def _recorded(spec: EnvSpec, names: Collection[str]) -> EnvSpec:
    """Return the specification of what is written: its fields alone, without states."""
    kept = tuple(field for field in spec.observation.fields if field.name in names)
    return replace(spec, observation=replace(spec.observation, fields=kept), state_size=0)


def _box(values: np.ndarray) -> dict[str, Any]:
    """Return Minari's words for the space of a field, (T, ...)."""
    shape, pictured = values.shape[1:], values.dtype == np.uint8
    low, high = (0, 255) if pictured else (-np.inf, np.inf)
    ends = {end: np.full(shape, value).tolist() for end, value in (("low", low), ("high", high))}
    return {"type": "Box", "dtype": str(values.dtype), "shape": list(shape), **ends}
