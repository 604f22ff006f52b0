"""Checkpoints and saved policies: folders that are whole and unaltered, or refused.

A sealed folder holds arrays (``arrays.safetensors``), plain state such as counters and generator states
(``state.json``), configuration (``config.yaml``) and ``manifest.json`` with the size and SHA-256 of each of them
and of itself. It appears under its name in one rename, after everything in it has reached the disk.
Nothing is ever pickled, so reading a folder of unknown origin cannot run code.
"""

import hashlib
import json
import logging
import os
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from safetensors import SafetensorError
from safetensors.numpy import load as load_safetensors
from safetensors.numpy import save as save_safetensors

from aerial_il.core.bounded import parse_json, parse_yaml, read_bytes
from aerial_il.core.errors import CheckpointError
from aerial_il.core.files import PlainDumper, sync_folder

VERSION = 1
MANIFEST = "manifest.json"
ARRAYS, STATE, CONFIG = "arrays.safetensors", "state.json", "config.yaml"
FOLDER = "checkpoints"
MAX_FILE_BYTES = 4 << 30
MAX_MANIFEST_BYTES = 1 << 20

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Checkpoint:
    """Contents of one sealed folder.

    Attributes:
        arrays: weights, optimiser moments, statistics.
        state: JSON values, e.g. the step and generator states.
        config: what rebuilds the objects that the arrays belong to.
    """

    arrays: Mapping[str, np.ndarray]
    state: Mapping[str, Any] = field(default_factory=dict)
    config: Mapping[str, Any] = field(default_factory=dict)


def save(folder: str | os.PathLike[str], checkpoint: Checkpoint) -> Path:
    """Write ``checkpoint`` as ``folder``, which then exists whole or, if anything fails, not at all.

    Raises:
        CheckpointError: the disk is full or the place not writable; what was there before is untouched.
    """
    folder = Path(folder)
    temporary = folder.with_name(f".{folder.name}.{os.getpid()}.tmp")
    try:
        shutil.rmtree(temporary, ignore_errors=True)
        temporary.mkdir(parents=True)
        for name, content in _sealed(_encode(checkpoint)).items():
            _write_synced(temporary / name, content)
        sync_folder(temporary)
        _replace_folder(temporary, folder)
    except OSError as error:
        shutil.rmtree(temporary, ignore_errors=True)
        hint = "Earlier checkpoints are intact: free some space and run the same command again."
        raise CheckpointError(folder, f"cannot be written ({error.strerror}).", hint) from error
    return folder


def load(folder: str | os.PathLike[str]) -> Checkpoint:
    """Read a sealed folder, checking every byte.

    Raises:
        CheckpointError: it is missing, cut, altered or of another version; names the file at fault.
    """
    folder = Path(folder)
    entries = _read_manifest(folder / MANIFEST)["files"]
    try:
        arrays, state, config = (_read_checked(folder / name, entries[name]) for name in (ARRAYS, STATE, CONFIG))
        return Checkpoint(load_safetensors(arrays), parse_json(state), parse_yaml(CONFIG, config))
    except (KeyError, TypeError, ValueError, SafetensorError) as error:
        raise CheckpointError(folder, f"is sealed but not a checkpoint ({error}).") from error


def is_sealed(folder: str | os.PathLike[str]) -> bool:
    """Whether ``folder`` looks like a checkpoint or saved policy, valid or not."""
    return (Path(folder) / MANIFEST).is_file()


def digest(checkpoint: Checkpoint) -> str:
    """Return the SHA-256 of what :func:`save` would seal: equal contents have equal digests, wherever they lie."""
    return _sha256(_sealed(_encode(checkpoint))[MANIFEST])


def sealed_digest(folder: str | os.PathLike[str]) -> str:
    """Return the :func:`digest` of what is saved in ``folder``, which is not read."""
    return _sha256(_read(Path(folder) / MANIFEST, MAX_MANIFEST_BYTES))


def step_folder(run: str | os.PathLike[str], step: int) -> Path:
    """Return the folder of the checkpoint that a run takes after ``step`` steps."""
    return Path(run) / FOLDER / f"{step:08d}"


def latest(run: str | os.PathLike[str]) -> tuple[Path, Checkpoint] | None:
    """Return the newest valid checkpoint of a run, or None if it has not taken any.

    Damaged ones are logged and passed over.

    Raises:
        CheckpointError: there are checkpoints, and every one of them is damaged.
    """
    refused: CheckpointError | None = None
    for folder in _newest_first(run):
        try:
            return folder, load(folder)
        except CheckpointError as error:
            log.warning("Checkpoint refused, trying the one before it. %s", error)
            refused = error
    if refused:
        hint = f"{refused.hint} Delete {Path(run) / FOLDER} to start the run again.".lstrip()
        raise CheckpointError(refused.path, f"{refused.problem} No other checkpoint is valid.", hint) from refused
    return None


def prune(run: str | os.PathLike[str], keep: int = 3) -> None:
    """Delete all but the newest ``keep`` checkpoints of a run, and what killed writers left behind."""
    for folder in list(_newest_first(run))[max(keep, 1) :]:
        condemned = folder.with_name(f".{folder.name}.old")
        os.replace(folder, condemned)
    for leftover in (Path(run) / FOLDER).glob(".*"):
        shutil.rmtree(leftover, ignore_errors=True)


def _newest_first(run: str | os.PathLike[str]) -> Iterator[Path]:
    if (Path(run) / FOLDER).is_symlink():  # old ones are deleted: not those of another folder
        raise CheckpointError(Path(run) / FOLDER, "is a link.", "Put the folder itself there.")
    folders = [f for f in (Path(run) / FOLDER).glob("*") if f.name.isdigit() and f.is_dir()]
    yield from sorted(folders, key=lambda f: int(f.name), reverse=True)


def _encode(checkpoint: Checkpoint) -> dict[str, bytes]:
    arrays = {name: np.asarray(array, order="C") for name, array in checkpoint.arrays.items()}
    return {
        ARRAYS: save_safetensors(arrays),
        STATE: json.dumps(checkpoint.state, allow_nan=False).encode(),
        CONFIG: yaml.dump(dict(checkpoint.config), Dumper=PlainDumper, sort_keys=False).encode(),
    }


def _sealed(files: dict[str, bytes]) -> dict[str, bytes]:
    entries = {name: {"bytes": len(data), "sha256": _sha256(data)} for name, data in files.items()}
    return {**files, MANIFEST: _manifest_bytes({"version": VERSION, "files": entries})}


def _manifest_bytes(body: dict[str, Any]) -> bytes:
    seal = _sha256(json.dumps(body).encode())
    return (json.dumps({**body, "seal": seal}, indent=2) + "\n").encode()


def _read_manifest(path: Path) -> dict[str, Any]:
    raw = _read(path, MAX_MANIFEST_BYTES)
    try:
        manifest = parse_json(raw)
        version, body = manifest["version"], {key: manifest[key] for key in ("version", "files")}
    except (ValueError, KeyError, TypeError) as error:
        raise CheckpointError(path, f"is not a checkpoint's manifest ({error!r}).") from error
    if version != VERSION:
        hint = "Read it with the release of aerial_il that wrote it."
        raise CheckpointError(path, f"has format version {version!r}; this release reads {VERSION}.", hint)
    if raw != _manifest_bytes(body):
        raise CheckpointError(path, "was altered after it was sealed.")
    return manifest


def _read_checked(path: Path, entry: Mapping[str, Any]) -> bytes:
    data = _read(path)
    if len(data) != entry["bytes"]:
        raise CheckpointError(path, f"has {len(data)} bytes, sealed with {entry['bytes']}.")
    if _sha256(data) != entry["sha256"]:
        raise CheckpointError(path, "was altered after it was sealed: its SHA-256 differs from the manifest's.")
    return data


def _read(path: Path, most: int = MAX_FILE_BYTES) -> bytes:
    try:
        return read_bytes(path, most=most)
    except OSError as error:
        raise CheckpointError(path, f"cannot be read ({error.strerror}).") from error
    except ValueError as error:
        raise CheckpointError(path, f"cannot be read ({error}).") from error


def _write_synced(path: Path, content: bytes) -> None:
    with open(path, "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def _replace_folder(source: Path, target: Path) -> None:
    """Rename ``source`` to ``target``; an older ``target`` steps aside first, since folders cannot be replaced."""
    aside = target.with_name(f".{target.name}.old")
    shutil.rmtree(aside, ignore_errors=True)
    if target.exists():
        os.replace(target, aside)
    os.replace(source, target)
    sync_folder(target.parent)
    shutil.rmtree(aside, ignore_errors=True)


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
