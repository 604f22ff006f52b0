"""Open recorded or foreign demonstrations under one interface: a sequence of episodes."""

from __future__ import annotations

import logging
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from itertools import islice
from pathlib import Path

from aerial_il.core.computer import MEMORY_MB
from aerial_il.core.errors import DemoError
from aerial_il.core.specs import EnvSpec
from aerial_il.data.episode import Episode
from aerial_il.data.folder import FAILURES, DatasetFolder
from aerial_il.data.formats import find
from aerial_il.data.provenance import made_by
from aerial_il.data.source import Cameras, Source, Wanted
from aerial_il.data.survey import Loader, Survey, surveyed

log = logging.getLogger(__name__)
AHEAD = 2  # episodes that are read while another one is used

COLLECT = "Record some with: aerial-il collect robot=R task=T episodes=100 out={}"
SEVERAL = "Of several datasets, the first is dataset=PATH, the rest are dataset.others=[PATH,PATH]."


class Dataset:
    """A sequence of episodes that are read, and checked, when they are asked for.

    Args:
        path: where they lie.
        survey: what opening it has shown.
        parts: the datasets that it is put together from, if it is a folder of them.
        strict: whether an episode that cannot be used is an error, rather than passed over with a word.
    """

    def __init__(self, path: Path, survey: Survey, parts: Sequence[Dataset] = (), *, strict: bool = False) -> None:
        self.path, self.survey, self.strict = path, survey, strict
        self.parts = tuple(parts) or (self,)

    @property
    def _loaders(self) -> Mapping[str, Loader]:
        return self.survey.loaders

    @property
    def files(self) -> Mapping[str, Path]:
        """Uid -> the file of a recorded episode, where each has one of its own."""
        return self.survey.files

    @property
    def uids(self) -> tuple[str, ...]:
        return tuple(self._loaders)

    @property
    def spec(self) -> EnvSpec:
        """The specification of the environment of the first episode that can be read."""
        *others, last = self._loaders.values()
        for load in others:
            try:
                return load().spec
            except DemoError:
                if self.strict:
                    raise
        return last().spec

    def __repr__(self) -> str:
        return f"Dataset({self.path}: {len(self)} episodes)"

    def __len__(self) -> int:
        return len(self._loaders)

    def __iter__(self) -> Iterator[Episode]:
        """Yield the episodes in order; while one is used, threads read the next ones.

        Raises:
            DemoError: none can be used; or one cannot, and the dataset is strict.
        """
        found, left_out = 0, list[DemoError]()
        for result in self._read_ahead():
            try:
                episode = result.result()
            except DemoError as error:
                if self.strict:
                    raise
                left_out.append(error)
            else:
                found += 1
                yield episode
        if left_out and not found:
            raise left_out[0]
        if left_out:
            said = f"{len(left_out)} of {len(self)} episodes are left out, the first as {left_out[0]}"
            log.warning("%s See: aerial-il validate %s", said, self.path)

    def _read_ahead(self) -> Iterator[Future[Episode]]:
        with ThreadPoolExecutor(AHEAD) as pool:
            loaders, ahead = iter(self._loaders.values()), deque[Future[Episode]]()
            ahead.extend(pool.submit(load) for load in islice(loaders, AHEAD))
            while ahead:
                result = ahead.popleft()
                result.exception()
                ahead.extend(pool.submit(load) for load in islice(loaders, 1))
                yield result

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
        found: dict[str, dict[str, Loader]] = {}
        for part in self.parts:
            found.setdefault(part.spec.task, {}).update(part._loaders)
        return [Dataset(self.path, Survey(loaders), strict=self.strict) for loaders in found.values()]

    def one_of_each(self) -> list[Episode]:
        """Return an episode for every way in which those of the dataset, by their names, were made."""
        found = {(id(part), made_by(uid)): part._loaders[uid] for part in self.parts for uid in reversed(part.uids)}
        return [load() for load in found.values()]

    def only(self, uids: Iterable[str]) -> Dataset:
        """Return the dataset of some of the episodes, in the order of ``uids``."""
        return Dataset(self.path, Survey({uid: self._loaders[uid] for uid in uids}), strict=self.strict)

    def mapped(self, change: Callable[[Episode], Episode]) -> Dataset:
        """Return the dataset of what ``change`` makes of each episode once that is read."""
        loaders = {uid: partial(_changed, load, change) for uid, load in self._loaders.items()}
        return Dataset(self.path, Survey(loaders), strict=self.strict)

    def problems(self) -> Iterator[tuple[str, DemoError | None]]:
        """Read every episode; yield its uid and why it cannot be used, or None; those left out at once come first."""
        yield from self.survey.left_out.items()
        for uid, load in self._loaders.items():
            try:
                load()
            except DemoError as error:
                yield uid, error
            else:
                yield uid, None

    def notes(self) -> Iterator[str]:
        """Yield what is odd about episodes or was mended, and what is taken for granted as no file says it."""
        for uid, notes in self.survey.notes.items():
            yield from (f"{self.path}: {uid} {note}" for note in notes)
        yield from (f"{self.path}: taken for granted: {each}." for each in self.survey.assumed)


def open_dataset(
    path: str | os.PathLike[str],
    *,
    cameras: Cameras = False,
    failures: bool = False,
    states: bool = True,
    success: str | None = None,
    control_dt: float | None = None,
    filter_key: str | None = None,
    terminals: bool | None = None,
    strict: bool = False,
    memory_mb: int = MEMORY_MB,
) -> Dataset:
    """Open demonstrations, whatever form they are in; what it returns has passed :mod:`aerial_il.data.check`.

    Args:
        path: a folder of recordings or of such folders, an MCAP file, a LeRobot v3, Minari or ALOHA folder, an HDF5
            file of robomimic's or D4RL's layout, transitions as ``.npz``, or what a format of your own recognises.
        cameras: True to decode all image fields, or the names of some.
        failures: also the failed episodes of a folder of recordings; each episode says how it ended.
        states: False to leave out the simulator's states, most of a recording, which no training looks at.
        success: what is one: ``all``, a last ``reward`` above zero, ``return:R`` (at least R), ``terminal`` (the
            environment ended it) or ``survived`` (it did not); None for what the format says.
        control_dt: s between two actions; None for what the format says.
        filter_key: the part of the dataset to take, e.g. ``train`` of robomimic's ``mask``; None for all.
        terminals: whether an end of which the format does not say what it means, or even one that it calls terminal
            (False), is a terminal state; None for what the format says, and open ends where it says nothing.
        strict: refuse a dataset for one episode that cannot be used, instead of leaving that out with a word.
        memory_mb: the most that one episode may take, MB.

    Raises:
        DemoError: there is nothing to open, something that the index lists is missing, or it cannot be used.
        InvalidValueError, UnknownNameError: an answer is none, or there is no camera or part of that name.
    """
    path = Path(path)
    if not path.exists():
        hint = SEVERAL if str(path).startswith("[") else COLLECT.format(path)
        raise DemoError(path, "does not exist.", hint=hint)
    wanted = Wanted(
        cameras=cameras, failures=failures, states=states, success=success, control_dt=control_dt,
        filter_key=filter_key, terminals=terminals, strict=strict, memory_mb=memory_mb,
    )  # fmt: skip
    return _dataset(find(path).read(path, wanted), wanted)


def _dataset(source: Source, wanted: Wanted) -> Dataset:
    survey = surveyed(source, wanted)
    if not survey.loaders:
        if failures := len(DatasetFolder(source.path).files(FAILURES)):
            hint = f"Look at them: aerial-il info {source.path}"
            raise DemoError(source.path, f"holds no demonstrations: none of {failures} flights succeeded.", hint=hint)
        raise DemoError(source.path, "holds no demonstrations.", hint=COLLECT.format(source.path))
    parts = [_dataset(part, wanted) for part in source.parts]
    return Dataset(source.path, survey, parts, strict=wanted.strict)


def _changed(load: Loader, change: Callable[[Episode], Episode]) -> Episode:
    return change(load())


def altered_files(path: str | os.PathLike[str]) -> list[Path]:
    """Return the files whose SHA-256 differs from what was listed when they were written.

    Args:
        path: a dataset folder, a folder of such folders, or one recording, judged by the index where it lies; or a
            LeRobot dataset made of recordings. Other formats keep no digests of files.
    """
    form = find(Path(path))
    return form.altered(Path(path)) if hasattr(form, "altered") else []
