"""Write recordings as a dataset of Minari's, the folder with ``data/main_data.hdf5`` and ``data/metadata.json``.

Observations are a dictionary of the recorded fields, or the field itself where there is one alone; pictures are stored
as they are, without JPEG. ``aerial_il_spec`` in the metadata keeps the specification, which our reader prefers.

Source: Minari 0.5, ``HDF5Storage`` and ``serialize_space``.
"""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import sync_folder
from aerial_il.core.specs import EnvSpec
from aerial_il.data.episode import Episode
from aerial_il.data.formats.minari import FILE, METADATA, SPEC, SUCCESS
from aerial_il.data.recording.writer import storing

VERSION = "0.5.4"  # of Minari, whose layout this is; its readers check it
NAME = re.compile(r"[-_\w]+-v\d+")


def convert_to_minari(episodes: Sequence[Episode], out: str | os.PathLike[str], *, env_spec: str | None = None) -> Path:
    """Write episodes of one environment as one dataset, which appears whole or not at all.

    Args:
        episodes: whose actions are the labels to be learned.
        out: its folder, NAME-vN, which is the name that Minari knows it by; one that is there is replaced.
        env_spec: Gymnasium's specification of the environment, as JSON.

    Raises:
        InvalidValueError: the name is none of Minari's, or ``out`` holds something else.
        StorageError: the disk is full or the folder not writable.
    """
    out = Path(out)
    if not NAME.fullmatch(out.name):
        raise InvalidValueError(
            f"out={out}: a dataset of Minari's is named NAME-vN, e.g. {out.with_name('flights-v0')}."
        )
    if out.exists() and not (out / METADATA).is_file():
        raise InvalidValueError(f"out={out} is there and holds no dataset of Minari's: choose another name.")
    temporary = out.with_name(f".{out.name}.{os.getpid()}.tmp")
    try:
        with storing(out):
            (temporary / FILE).parent.mkdir(parents=True)
            _write(temporary / FILE, episodes)
            size_mb = round((temporary / FILE).stat().st_size / 1e6, 1)
            told = {**_metadata(episodes, out.name), "dataset_size": size_mb}
            told |= {"env_spec": env_spec} if env_spec else {}
            (temporary / METADATA).write_text(json.dumps(told))
            shutil.rmtree(out, ignore_errors=True)
            os.replace(temporary, out)
            sync_folder(out.parent)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return out


def _write(path: Path, episodes: Sequence[Episode]) -> None:
    with h5py.File(path, "w", track_order=True) as file:
        for number, episode in enumerate(episodes):
            group = file.create_group(f"episode_{number}")
            group.attrs.update({"id": number, "total_steps": len(episode), "uid": episode.uid})
            group.attrs[SUCCESS] = episode.success
            over = np.arange(len(episode)) == len(episode) - 1
            columns = {
                "actions": episode.labels, "rewards": episode.rewards,
                "terminations": episode.terminated, "truncations": over & ~episode.terminated,
            }  # fmt: skip
            observed = {f"observations/{name}": values for name, values in episode.obs.items()}
            if len(observed) == 1:
                observed = {"observations": next(iter(observed.values()))}
            for name, values in {**columns, **observed}.items():
                group.create_dataset(name, data=values, chunks=True, maxshape=(None, *values.shape[1:]))


def _metadata(episodes: Sequence[Episode], name: str) -> dict[str, Any]:
    spec, first = episodes[0].spec, episodes[0]
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
        "total_episodes": len(episodes),
        "total_steps": sum(map(len, episodes)),
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
