"""ALOHA's recordings: a file ``episode_<i>.hdf5`` for each demonstration, or a folder of them.

A file holds ``/observations/qpos``, and perhaps ``qvel``, ``effort`` and ``images/<camera>``, and ``/action``, all of T
rows at 50 Hz; its attributes ``sim`` and ``compress`` say whether it was simulated, and whether images are JPEG, padded
with zeros. Nobody says which succeeded: all were meant to be imitated.

Source: T. Zhao et al., "Learning Fine-Grained Bimanual Manipulation with Low-Cost Hardware", 2023, ``record_episodes``.
"""

import io
from functools import partial
from pathlib import Path

import h5py
import numpy as np
from PIL import Image

from aerial_il.core.errors import DemoError
from aerial_il.core.specs import image_name
from aerial_il.data.formats.parts.hdf5 import child, holds, later, numbered, opened
from aerial_il.data.formats.parts.hdf5_probe import look_at
from aerial_il.data.source import Later, Raw, Source, Wanted

PERIOD_S, NUMBERS = 0.02, ("qpos", "qvel", "effort")


def recognises(path: Path) -> bool:
    files = _files(path)
    if path.is_dir():
        look_at(file for file in files if file.is_file())
    return bool(files) and holds(files[0], "observations/qpos", "action")


def read(path: Path, wanted: Wanted) -> Source:
    raw = {file.stem: partial(_raw, file) for file in _files(path)}
    return Source(path=path, kind="an ALOHA recording", raw=raw, robot="aloha", control_dt_s=PERIOD_S)


def _files(path: Path) -> list[Path]:
    result = {file.stem: file for file in path.glob("episode_*.hdf5")} if path.is_dir() else {path.stem: path}
    return [result[name] for name in numbered(result)]


def _raw(file: Path) -> Raw:
    with opened(file, "holds a malformed demonstration") as raw:
        seen = child(file, raw, "observations", h5py.Group)
        obs = {name: later(file, seen, name) for name in NUMBERS if name in seen}
        if "images" in seen:
            images, compressed = child(file, seen, "images", h5py.Group), bool(raw.attrs.get("compress", False))
            for camera in map(str, images):
                pictures = later(file, images, camera)
                obs[image_name(camera)] = _compressed(file, pictures) if compressed else pictures
        simulated = bool(raw.attrs.get("sim", False))
        return Raw(obs=obs, actions=later(file, raw, "action"), provenance={"policy": "human", "simulated": simulated})


def _compressed(file: Path, packed: Later) -> Later:
    shape = _decoded(file, packed[:1].read()[0]).shape
    load = lambda chosen: np.stack([_decoded(file, each) for each in packed.load(chosen)])  # noqa: E731
    return Later((len(packed), *shape), np.dtype(np.uint8), load)


def _decoded(file: Path, padded: np.ndarray) -> np.ndarray:
    try:
        return np.asarray(Image.open(io.BytesIO(padded.tobytes()), formats=("JPEG",)))
    except (OSError, SyntaxError, Image.DecompressionBombError) as error:
        raise DemoError(file, f"has a picture that cannot be decoded ({error}).") from error
