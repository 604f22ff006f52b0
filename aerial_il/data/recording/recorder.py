"""Record n worlds at once, while they fly on: their steps are gathered here, and written by other threads.

Each world's steps gather in a block of its own until there are `STEPS_PER_CHUNK`, which then go to that world's file.
They are counted from the start of the episode, so a file's bytes do not depend on how many worlds flew beside it.

What a flight waits for: never for a file, unless `BLOCK_BYTES` of full blocks wait to be written, because the disk is
slower than the flight. What a kill takes: of each world the episode that is being flown or written, for a world gets
its next episode when the last one has its name.
"""

import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from queue import LifoQueue
from typing import Any

import numpy as np

from aerial_il.core.specs import EnvSpec
from aerial_il.data.recording.encoding import images
from aerial_il.data.recording.encoding.packing import bytes_of, gather
from aerial_il.data.recording.encoding.topics import NO_EXTRAS, Extras, place_of
from aerial_il.data.recording.schema import Layout
from aerial_il.data.recording.threads import WriterThreads
from aerial_il.data.recording.writer import NOTHING, STEPS_PER_CHUNK, EpisodeWriter

BLOCK_BYTES = 64 << 20  # of blocks that wait to be written

Pictures = dict[str, list[Future[bytes]]]


@dataclass(frozen=True)
class Recorded:
    """A file that has its name: where it is, and the SHA-256 of its bytes."""

    path: Path
    sha256: str


class Recorder:
    """Collects the steps of n worlds and hands them to the episode writers of those that are being recorded.

    A step is recorded by :meth:`observe`, then :meth:`act`; after the last one comes another :meth:`observe` and then
    :meth:`finish`. Worlds without a writer are passed over. All methods raise what a writer has met before.

    Args:
        spec: the environment's specification; its image fields are recorded too.
        ctrl_size: number of actuator controls.
        num_envs: number of worlds n.
        extras: name -> labels of further numbers that :meth:`act` is given at each step.
    """

    def __init__(self, spec: EnvSpec, ctrl_size: int, num_envs: int = 1, extras: Extras = NO_EXTRAS) -> None:
        self.layout = Layout(spec, ctrl_size, extras)
        self._observed = spec.observation.state_names
        places = {name: place_of(self.layout.row, name) for name in self.layout.row.names or ()}
        self._places = {name: (dtype.base, first) for name, (dtype, first) in places.items()}
        self._writers: list[EpisodeWriter | None] = [None] * num_envs
        self._recording = np.zeros(num_envs, bool)
        self._count = np.zeros(num_envs, int)  # whole steps in the block of each world
        spare = max(1, min(num_envs, BLOCK_BYTES // (STEPS_PER_CHUNK * self.layout.row.itemsize)))
        self._blocks = np.zeros((num_envs + spare, STEPS_PER_CHUNK), self.layout.row)
        self._block = np.arange(num_envs)  # of each world
        self._spare: LifoQueue[int] = LifoQueue()
        for block in range(num_envs, num_envs + spare):
            self._spare.put(block)
        cameras = [field.name for field in spec.observation.of_group("image")]
        self._images: dict[str, list[list[Future[bytes]]]] = {name: [[] for _ in range(num_envs)] for name in cameras}
        self._encoders = ThreadPoolExecutor(os.cpu_count()) if cameras else None
        self._threads = WriterThreads()

    @property
    def recording(self) -> np.ndarray:
        """(n,) bool, the worlds that have a writer."""
        return self._recording

    def begin(self, world: int, writer: EpisodeWriter) -> None:
        """Record ``world`` into ``writer`` from now on."""
        self._writers[world], self._recording[world], self._count[world] = writer, True, 0
        for worlds in self._images.values():
            worlds[world] = []

    def observe(self, obs: Mapping[str, np.ndarray], *, state: np.ndarray, sim_time: np.ndarray) -> None:
        """Record what all worlds (n, ...) show before the next step: observation, full state (n, S) and time (n,).

        Told twice before a step, the second time counts: whoever ends an episode tells what all worlds show.
        """
        flat = self.layout.spec.observation.flatten(obs, self._observed)
        self._store({"observation": flat, "state": state, "sim_time": sim_time})
        for name, worlds in self._images.items():
            for world in np.flatnonzero(self._recording):
                del worlds[world][self._count[world] :]
                worlds[world].append(self._encode(obs[name][world]))

    def act(self, **step: np.ndarray) -> None:
        """Record the outcome of one step of all worlds.

        Args:
            step: the other fields of ``Step`` by name, each (n, ...): ``action``, ``executed_action``,
                ``expert_action`` (NaN where nobody was asked), ``ctrl``, ``reward``, ``terminated``, ``truncated``,
                ``is_intervention``, ``phase``; and the extras.
        """
        self._store(step)
        self._count[self._recording] += 1
        for world in np.flatnonzero(self._recording & (self._count == STEPS_PER_CHUNK)).tolist():
            writer = self._writers[world]
            assert writer is not None
            self._hand_over(world, _append, writer, STEPS_PER_CHUNK)

    def finish(
        self,
        world: int,
        *,
        success: bool,
        path: Path | None = None,
        note: str = "",
        made_of: Mapping[str, Any] = NOTHING,
    ) -> Future[Recorded]:
        """End the episode of ``world`` with what it showed last, and name its file ``path`` or as its writer knows.

        ``note`` and ``made_of``: see :meth:`EpisodeWriter.finish`.

        Returns:
            What is known when the file has its name.
        """
        writer, count = self._writer(world), int(self._count[world])
        outcome = {"success": success, "path": path, "note": note, "made_of": made_of}
        done = self._hand_over(world, _finish, writer, count, **outcome)
        self._release(world)  # not before: an interruption while it waits for a block leaves the writer to `close`
        return done

    def discard(self, world: int) -> None:
        """Forget the episode of ``world``."""
        self._threads.submit(world, self._release(world).discard).result()

    def close(self) -> None:
        """Wait for what is to be written, and leave unfinished episodes as ``.part`` files."""
        self._threads.close()
        for world in np.flatnonzero(self._recording):
            self._release(int(world)).abandon()
        if self._encoders:
            self._encoders.shutdown(cancel_futures=True)

    def _store(self, values: Mapping[str, np.ndarray]) -> None:
        self._threads.check()
        worlds, rows = np.flatnonzero(self._recording), bytes_of(self._blocks)
        fields = [(self._places[name][1], np.asarray(value, self._places[name][0])) for name, value in values.items()]
        gather(rows, (worlds, self._block, self._count), fields)

    def _hand_over[T](
        self, world: int, job: Callable[..., T], writer: EpisodeWriter, count: int, **more: Any
    ) -> Future[T]:
        """Let a writer thread do ``job`` with the block of ``world``, which gets another one."""
        block, pictures = int(self._block[world]), self._take_images(world, count + (job is _finish))
        self._block[world], self._count[world] = self._spare.get(), 0
        done = self._threads.submit(world, job, writer, self._blocks[block], count, pictures, **more)
        done.add_done_callback(lambda _: self._spare.put(block))
        return done

    def _writer(self, world: int) -> EpisodeWriter:
        writer = self._writers[world]
        if writer is None:
            raise ValueError(f"World {world} is not being recorded.")
        return writer

    def _release(self, world: int) -> EpisodeWriter:
        writer = self._writer(world)
        self._writers[world], self._recording[world] = None, False
        return writer

    def _encode(self, image: np.ndarray) -> Future[bytes]:
        assert self._encoders is not None
        return self._encoders.submit(images.encode, image.copy())

    def _take_images(self, world: int, count: int) -> Pictures:
        taken = {name: worlds[world][:count] for name, worlds in self._images.items()}
        for worlds in self._images.values():
            del worlds[world][:count]
        return taken


def _append(writer: EpisodeWriter, block: np.ndarray, count: int, pictures: Pictures) -> None:
    with _closed_on_failure(writer):
        writer.append(block[:count], _encoded(pictures))


def _finish(
    writer: EpisodeWriter,
    block: np.ndarray,
    count: int,
    pictures: Pictures,
    **outcome: Any,
) -> Recorded:
    """Append ``count`` steps, end with what followed them, and return the file."""
    with _closed_on_failure(writer):
        done = writer.finish(block[: count + 1], _encoded(pictures), **outcome)
    return Recorded(done, writer.sha256)


@contextmanager
def _closed_on_failure(writer: EpisodeWriter) -> Iterator[None]:
    try:
        yield
    except BaseException:
        writer.abandon()
        raise


def _encoded(pictures: Pictures) -> dict[str, list[bytes]]:
    return {name: [future.result() for future in futures] for name, futures in pictures.items()}
