"""Our recordings: one MCAP file an episode, alone, in a dataset's folder, or in a folder of such folders."""

from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path

from aerial_il.core.errors import DemoError
from aerial_il.core.files import sha256_of
from aerial_il.data.episode import Episode
from aerial_il.data.folder import DEMOS, FAILURES, INDEX, DatasetFolder
from aerial_il.data.recording.reader import decode_episode
from aerial_il.data.source import Source, Wanted
from aerial_il.data.survey import Loader


def recognises(path: Path) -> bool:
    if path.is_dir():
        return (path / INDEX).exists() or (path / DEMOS).is_dir() or any(path.glob(f"*/{INDEX}")) or bool(_loose(path))
    return path.name.endswith((".mcap", ".mcap.part"))


def read(path: Path, wanted: Wanted) -> Source:
    if path.is_file():
        return _source(path, [path], wanted)
    if (path / INDEX).exists() or (path / DEMOS).is_dir():
        return _source(path, _listed(DatasetFolder(path), wanted), wanted)
    if inner := _inner(path):
        parts = [read(folder, wanted) for folder in inner]
        recorded, files = _together(parts)
        return Source(path=path, kind="recordings", recorded=recorded, files=files, parts=parts)
    return _source(path, _loose(path), wanted)


def _together(parts: Iterable[Source]) -> tuple[dict[str, Loader], dict[str, Path]]:
    """Return the recordings of several folders: one of equal files, and of different ones of one name both.

    Two sessions of a person begin at the same seed; the later one is then called by its folder, too.
    """
    recorded, files = dict[str, Loader](), dict[str, Path]()
    for part in parts:
        for uid, load in part.recorded.items():
            file, name = part.files[uid], uid
            if uid in files and sha256_of(file) != sha256_of(files[uid]):
                name, load = f"{part.path.name}-{uid}", partial(_called, load, f"{part.path.name}-{uid}")
            recorded[name], files[name] = load, file
    return recorded, files


def _called(load: Loader, name: str) -> Episode:
    return replace(load(), uid=name)


def altered(path: Path) -> list[Path]:
    """Return the recordings whose SHA-256 differs from the index of their folder; one file is judged where it lies."""
    if path.is_file():
        home = path.resolve().parent
        return [path] if path.resolve() in _altered(DatasetFolder(home.parent), home.name, path.stem) else []
    folders = [path, *_inner(path)] if (path / INDEX).is_file() else _inner(path)
    return [file for folder in folders for kind in (DEMOS, FAILURES) for file in _altered(DatasetFolder(folder), kind)]


def _source(path: Path, files: Iterable[Path], wanted: Wanted) -> Source:
    named = {file.stem: file for file in files}
    recorded = {
        uid: partial(decode_episode, file, cameras=wanted.cameras, states=wanted.states) for uid, file in named.items()
    }
    return Source(path=path, kind="recordings", recorded=recorded, files=named)


def _listed(folder: DatasetFolder, wanted: Wanted) -> list[Path]:
    index, files = folder.read_index(), []
    for kind in (DEMOS, FAILURES) if wanted.failures else (DEMOS,):
        found = folder.files(kind)
        if missing := sorted(index.get(kind, {}).keys() - {file.stem for file in found}):
            hint = f"Restore it, or accept the loss with: aerial-il recover path={folder.path}"
            raise DemoError(folder.file(missing[0], kind), "is listed in the index but missing.", hint=hint)
        files += found
    return files


def _altered(folder: DatasetFolder, kind: str, uid: str = "*") -> list[Path]:
    """Return the files of a kind, or that of one episode, which are not what the folder's index lists."""
    listed = folder.read_index().get(kind, {})
    files = [file for file in folder.files(kind) if uid in ("*", file.stem)]
    return [file for file in files if listed.get(file.stem, digest := sha256_of(file)) != digest]


def _inner(path: Path) -> list[Path]:
    return sorted(index.parent for index in path.glob(f"*/{INDEX}"))


def _loose(path: Path) -> list[Path]:
    return sorted(path.glob("*.mcap"))
