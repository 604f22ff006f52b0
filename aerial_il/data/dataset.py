"""Open recorded or foreign demonstrations under one interface: a sequence of episodes."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from pathlib import Path

from aerial_il.core.errors import DemoError
from aerial_il.core.files import sha256_of
from aerial_il.core.specs import EnvSpec
from aerial_il.data.episode import Episode
from aerial_il.data.folder import DEMOS, FAILURES, INDEX, DatasetFolder
from aerial_il.data.provenance import made_by
from aerial_il.data.recording.reader import read_episode

AHEAD = 2  # episodes that are read while another one is used

Cameras = bool | Sequence[str]
COLLECT = "Record some with: aerial-il collect robot=R task=T episodes=100 out={}"


class Dataset:
    """A sequence of episodes that are read, and checked, when they are asked for.

    Args:
        path: where they lie.
        loaders: uid -> function that reads the episode.
        parts: the datasets that it is put together from, if it is a folder of them.
    """

    def __init__(self, path: Path, loaders: dict[str, Callable[[], Episode]], parts: Sequence[Dataset] = ()) -> None:
        self.path, self._loaders = path, loaders
        self.parts = tuple(parts) or (self,)

    @property
    def uids(self) -> tuple[str, ...]:
        return tuple(self._loaders)

    @property
    def spec(self) -> EnvSpec:
        """The specification of the first episode's environment."""
        return self[0].spec

    def __len__(self) -> int:
        return len(self._loaders)

    def __iter__(self) -> Iterator[Episode]:
        """Yield the episodes in order; while one is used, threads read the next ones."""
        with ThreadPoolExecutor(AHEAD) as pool:
            loaders, ahead = iter(self._loaders.values()), deque[Future[Episode]]()
            ahead.extend(pool.submit(load) for load in islice(loaders, AHEAD))
            while ahead:
                episode = ahead.popleft().result()
                ahead.extend(pool.submit(load) for load in islice(loaders, 1))
                yield episode

    def __getitem__(self, key: int | str) -> Episode:
        """Read one episode by index or uid."""
        uid = self.uids[key] if isinstance(key, int) else key
        if uid not in self._loaders:
            raise DemoError(
                self.path, f"has no episode {uid!r}.", hint=f"List them with: aerial-il info path={self.path}"
            )
        return self._loaders[uid]()

    def by_task(self) -> list[Dataset]:
        """Return the datasets of its tasks, each of the folders that it is put together from being of one task."""
        if len(self.parts) == 1:
            return [self]
        found: dict[str, dict[str, Callable[[], Episode]]] = {}
        for part in self.parts:
            found.setdefault(part.spec.task, {}).update(part._loaders)
        return [Dataset(self.path, loaders) for loaders in found.values()]

    def one_of_each(self) -> list[Episode]:
        """Return an episode for every way in which those of the dataset, by their names, were made."""
        found = {(id(part), made_by(uid)): part._loaders[uid] for part in self.parts for uid in reversed(part.uids)}
        return [load() for load in found.values()]

    def only(self, uids: Iterable[str]) -> Dataset:
        """Return the dataset of some of the episodes, in the order of ``uids``."""
        return Dataset(self.path, {uid: self._loaders[uid] for uid in uids})

    def problems(self) -> Iterator[tuple[str, DemoError | None]]:
        """Read every episode; yield its uid and what is wrong with it, or None."""
        for uid, load in self._loaders.items():
            try:
                load()
            except DemoError as error:
                yield uid, error
            else:
                yield uid, None


def open_dataset(path: str | os.PathLike[str], *, cameras: Cameras = False, failures: bool = False) -> Dataset:
    """Open demonstrations, whatever form they are in.

    Args:
        path: a folder of recordings or of such folders, an MCAP file, a LeRobot v3 or Minari folder, an HDF5
            file of robomimic's or D4RL's layout, or transitions as ``.npz``.
        cameras: True to decode all image fields, or the names of some.
        failures: also the failed episodes of a folder of recordings; each episode says how it ended.

    Raises:
        DemoError: there is nothing to open, or something that the index lists is missing.
    """
    path = Path(path)
    if not path.exists():
        raise DemoError(path, "does not exist.", hint=COLLECT.format(path))
    if path.suffix in (".hdf5", ".h5"):
        from aerial_il.data.formats.hdf5 import open_hdf5

        return Dataset(path, open_hdf5(path))
    if path.suffix == ".npz":
        from aerial_il.data.formats.transitions import open_npz

        return Dataset(path, open_npz(path))
    if path.is_file():
        return _open_files(path, [path], cameras)
    if (path / "meta" / "info.json").is_file():
        from aerial_il.data.formats.lerobot_import import open_lerobot

        return Dataset(path, open_lerobot(path, cameras))
    if (path / "data" / "main_data.hdf5").is_file():
        from aerial_il.data.formats.minari import open_minari

        return Dataset(path, open_minari(path))
    if (path / INDEX).exists() or (path / DEMOS).is_dir():
        return _open_folder(DatasetFolder(path), cameras, (DEMOS, FAILURES) if failures else (DEMOS,))
    if inner := sorted(index.parent for index in path.glob(f"*/{INDEX}")):
        found = [open_dataset(folder, cameras=cameras, failures=failures) for folder in inner]
        return Dataset(path, {uid: load for dataset in found for uid, load in dataset._loaders.items()}, found)
    return _open_files(path, sorted(path.glob("*.mcap")), cameras)


def _open_folder(folder: DatasetFolder, cameras: Cameras, kinds: Iterable[str]) -> Dataset:
    index, files = folder.read_index(), []
    for kind in kinds:
        found = folder.files(kind)
        if missing := sorted(index.get(kind, {}).keys() - {file.stem for file in found}):
            hint = f"Restore it, or accept the loss with: aerial-il recover path={folder.path}"
            raise DemoError(folder.file(missing[0], kind), "is listed in the index but missing.", hint=hint)
        files += found
    return _open_files(folder.path, files, cameras)


def _open_files(path: Path, files: Sequence[Path], cameras: Cameras) -> Dataset:
    if not files:
        raise DemoError(path, "holds no demonstrations.", hint=COLLECT.format(path))
    return Dataset(path, {file.stem: lambda file=file: read_episode(file, cameras=cameras) for file in files})


def altered_files(path: str | os.PathLike[str]) -> list[Path]:
    """Return the recordings whose SHA-256 differs from the index of their dataset folder.

    Args:
        path: a dataset folder, a folder of such folders, or one recording, judged by the index where it lies; or a
            LeRobot dataset made of recordings.
    """
    path = Path(path)
    if (path / "meta" / "info.json").is_file():
        from aerial_il.data.formats import lerobot_import

        return lerobot_import.altered_files(path)
    if path.is_file():
        home = path.resolve().parent
        return [path] if path.resolve() in _altered(DatasetFolder(home.parent), home.name, path.stem) else []
    folders = [DatasetFolder(index.parent) for index in (path / INDEX, *sorted(path.glob(f"*/{INDEX}")))]
    return [file for folder in folders for kind in (DEMOS, FAILURES) for file in _altered(folder, kind)]


def _altered(folder: DatasetFolder, kind: str, uid: str = "*") -> list[Path]:
    """Return the files of a kind, or that of one episode, which are not what the folder's index lists."""
    listed = folder.read_index().get(kind, {})
    files = [file for file in folder.files(kind) if uid in ("*", file.stem)]
    return [file for file in files if listed.get(file.stem, digest := sha256_of(file)) != digest]
