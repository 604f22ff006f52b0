"""ALOHA's recordings: a file ``episode_<i>.hdf5`` for each demonstration, or a folder of them.

A file holds ``/observations/qpos``, and perhaps ``qvel``, ``effort`` and ``images/<camera>``, and ``/action``, all of T
rows at 50 Hz; its attributes ``sim`` and ``compress`` say whether it was simulated, and whether images are JPEG, padded
with zeros. Nobody says which succeeded: all were meant to be imitated.

Source: T. Zhao et al., "Learning Fine-Grained Bimanual Manipulation with Low-Cost Hardware", 2023, ``record_episodes``.
"""

from __future__ import annotations

import io
from functools import partial
from pathlib import Path

import h5py
import numpy as np
from PIL import Image

from aerial_il.core.errors import DemoError
from aerial_il.core.specs import image_name
from aerial_il.data.formats.parts.hdf5 import array, child, holds, numbered, opened, require_size, rows
from aerial_il.data.source import Later, Raw, Source, Wanted

PERIOD_S, NUMBERS = 0.02, ("qpos", "qvel", "effort")
MAX_PICTURES_BYTES = 400 << 20  # of one camera in one demonstration


def recognises(path: Path) -> bool:
    files = _files(path)
    return bool(files) and holds(files[0], "observations/qpos", "action")


def read(path: Path, wanted: Wanted) -> Source:
    raw = {file.stem: partial(_raw, file, wanted) for file in _files(path)}
    return Source(path=path, kind="an ALOHA recording", raw=raw, robot="aloha", control_dt_s=PERIOD_S)


def _files(path: Path) -> list[Path]:
    result = {file.stem: file for file in path.glob("episode_*.hdf5")} if path.is_dir() else {path.stem: path}
    return [result[name] for name in numbered(result)]


def _raw(file: Path, wanted: Wanted) -> Raw:
    with opened(file, "holds a malformed demonstration") as raw:
        seen = child(file, raw, "observations", h5py.Group)
        names = [name for name in NUMBERS if name in seen]
        require_size(file, raw, [rows(file, raw, "action"), *(rows(file, seen, name) for name in names)])
        obs: dict[str, np.ndarray | Later] = {name: array(file, seen, name) for name in names}
        if "images" in seen and wanted.cameras:
            images, compressed = child(file, seen, "images", h5py.Group), bool(raw.attrs.get("compress", False))
            for camera in images:
                if wanted.cameras is True or image_name(camera) in wanted.cameras:
                    obs[image_name(camera)] = _pictures(file, rows(file, images, camera), compressed)
        simulated = bool(raw.attrs.get("sim", False))
        return Raw(obs=obs, actions=array(file, raw, "action"), provenance={"policy": "human", "simulated": simulated})


def _pictures(file: Path, images: h5py.Dataset, compressed: bool) -> Later:
    shape = (len(images), *(_decoded(file, images[0]).shape if compressed else images.shape[1:]))
    if (size := int(np.prod(shape, dtype=float))) > MAX_PICTURES_BYTES:
        raise DemoError(file, "is too large.", expected=f"at most {MAX_PICTURES_BYTES} bytes", got=size)
    place = str(images.name)

    def load() -> np.ndarray:
        with opened(file, f"has unreadable pictures in {place}") as raw:
            held = rows(file, raw, place)
            return np.stack([_decoded(file, picture) for picture in held]) if compressed else held[()]

    return Later(shape, np.dtype(np.uint8), load)


def _decoded(file: Path, padded: np.ndarray) -> np.ndarray:
    try:
        return np.asarray(Image.open(io.BytesIO(padded.tobytes()), formats=("JPEG",)))
    except (OSError, SyntaxError, Image.DecompressionBombError) as error:
        raise DemoError(file, f"has a picture that cannot be decoded ({error}).") from error
