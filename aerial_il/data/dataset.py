"""Open recorded or foreign demonstrations under one interface: a sequence of episodes."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from pathlib import Path

from aerial_il.core.errors import DemoError
from aerial_il.core.specs import EnvSpec
from aerial_il.data.check import checked
from aerial_il.data.episode import Episode
from aerial_il.data.formats import find
from aerial_il.data.provenance import made_by
from aerial_il.data.source import Cameras, Source, Wanted

AHEAD = 2  # episodes that are read while another one is used

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


def open_dataset(
    path: str | os.PathLike[str], *, cameras: Cameras = False, failures: bool = False, states: bool = True
) -> Dataset:
    """Open demonstrations, whatever form they are in.

    Args:
        path: a folder of recordings or of such folders, an MCAP file, a LeRobot v3 or Minari folder, an HDF5
            file of robomimic's or D4RL's layout, transitions as ``.npz``, or what a format of your own recognises.
        cameras: True to decode all image fields, or the names of some.
        failures: also the failed episodes of a folder of recordings; each episode says how it ended.
        states: False to leave out the simulator's states, most of a recording, which no training looks at.

    Raises:
        DemoError: there is nothing to open, something that the index lists is missing, or it cannot be used.
    """
    path = Path(path)
    if not path.exists():
        raise DemoError(path, "does not exist.", hint=COLLECT.format(path))
    return _dataset(find(path).read(path, Wanted(cameras=cameras, failures=failures, states=states)))


def _dataset(source: Source) -> Dataset:
    loaders = checked(source)
    if not loaders:
        raise DemoError(source.path, "holds no demonstrations.", hint=COLLECT.format(source.path))
    return Dataset(source.path, loaders, [_dataset(part) for part in source.parts])


def altered_files(path: str | os.PathLike[str]) -> list[Path]:
    """Return the files whose SHA-256 differs from what was listed when they were written.

    Args:
        path: a dataset folder, a folder of such folders, or one recording, judged by the index where it lies; or a
            LeRobot dataset made of recordings. Other formats keep no digests of files.
    """
    form = find(Path(path))
    return form.altered(Path(path)) if hasattr(form, "altered") else []
