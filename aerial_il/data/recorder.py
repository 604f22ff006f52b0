"""Record n worlds at once: one array assignment per field and control step, whatever n is.

Each world's steps gather in a row of its own until there are `STEPS_KEPT`, which then go to that world's file. They are
counted from the start of the episode, so a file's bytes do not depend on how many worlds flew beside it.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import numpy as np

from aerial_il.core.specs import EnvSpec
from aerial_il.data import images
from aerial_il.data.schema import Layout
from aerial_il.data.writer import EpisodeWriter

STEPS_KEPT = 64  # in memory, and lost by a kill: 1.3 s at 50 Hz
OBSERVED = ("sim_time", "observation", "state")


class Recorder:
    """Collects the steps of n worlds and hands them to the episode writers of those that are being recorded.

    A step is recorded by :meth:`observe`, then :meth:`act`; after the last one comes another :meth:`observe` and then
    :meth:`finish`. Worlds without a writer are passed over.

    Args:
        spec: the environment's specification; its image fields are recorded too.
        ctrl_size: number of actuator controls.
        num_envs: number of worlds n.
    """

    def __init__(self, spec: EnvSpec, ctrl_size: int, num_envs: int = 1) -> None:
        self.layout = Layout(spec, ctrl_size)
        self._spec = spec
        self._writers: list[EpisodeWriter | None] = [None] * num_envs
        self._recording = np.zeros(num_envs, bool)
        self._count = np.zeros(num_envs, int)  # whole steps in the row of each world
        step = self.layout.step.template.dtype
        fields = {name: step[name] for name in step.names or () if not name.startswith(("sec", "nanosec", "step"))}
        fields["observation"] = np.dtype((float, (spec.observation.size(spec.observation.state_names),)))
        for name in ("state", "ctrl"):  # an environment from outside may have neither
            fields.setdefault(name, np.dtype((float, (0,))))
        self._rows = {
            name: np.zeros((num_envs, STEPS_KEPT, *dtype.shape), dtype.base) for name, dtype in fields.items()
        }
        self._images: dict[str, list[list[Future[bytes]]]] = {
            camera.field: [[] for _ in range(num_envs)] for camera in self.layout.cameras
        }
        self._encoders = ThreadPoolExecutor(os.cpu_count()) if self.layout.cameras else None

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
        """Record what all worlds (n, ...) show before the next step: observation, full state (n, S) and time (n,)."""
        flat = self._spec.observation.flatten(obs, self._spec.observation.state_names)
        self._store({"observation": flat, "state": state, "sim_time": sim_time})
        for name, worlds in self._images.items():
            for world in np.flatnonzero(self._recording):
                worlds[world].append(self._encode(name, obs[name][world]))

    def act(self, **step: np.ndarray) -> None:
        """Record the outcome of one step of all worlds.

        Args:
            step: the other fields of ``Step`` by name, each (n, ...): ``action``, ``executed_action``,
                ``expert_action`` (NaN where nobody was asked), ``ctrl``, ``reward``, ``terminated``, ``truncated``,
                ``is_intervention``, ``phase``.
        """
        self._store(step)
        self._count[self._recording] += 1
        for world in np.flatnonzero(self._recording & (self._count == STEPS_KEPT)):
            self._flush(int(world))

    def finish(self, world: int, *, success: bool, path: Path | None = None, note: str = "") -> Path:
        """End the episode of ``world`` with what it showed last, and name its file ``path`` or as its writer knows.

        ``note`` is what is special about it, see :meth:`EpisodeWriter.finish`.
        """
        if self._count[world]:
            self._flush(world)
        writer = self._release(world)
        last = {name: self._rows[name][world, :1] for name in OBSERVED}
        return writer.finish(last, self._take_images(world, 1), success=success, path=path, note=note)

    def discard(self, world: int) -> None:
        """Forget the episode of ``world``."""
        self._release(world).discard()

    def close(self) -> None:
        """Leave unfinished episodes as ``.part`` files."""
        for world in np.flatnonzero(self._recording):
            self._release(int(world)).abandon()
        if self._encoders:
            self._encoders.shutdown(cancel_futures=True)

    def _store(self, values: Mapping[str, np.ndarray]) -> None:
        worlds = np.flatnonzero(self._recording)
        rows = self._count[worlds]
        for name, value in values.items():
            self._rows[name][worlds, rows] = value[worlds]

    def _flush(self, world: int) -> None:
        """Write the whole steps of ``world``; an observation without its step moves to the front."""
        count, writer = int(self._count[world]), self._writers[world]
        assert writer is not None
        block = {name: rows[world, :count] for name, rows in self._rows.items()}
        writer.append(block, self._take_images(world, count))
        self._count[world] = 0
        if count < STEPS_KEPT:
            for name in OBSERVED:
                self._rows[name][world, 0] = self._rows[name][world, count]

    def _release(self, world: int) -> EpisodeWriter:
        writer = self._writers[world]
        if writer is None:
            raise ValueError(f"World {world} is not being recorded.")
        self._writers[world], self._recording[world] = None, False
        return writer

    def _encode(self, name: str, image: np.ndarray) -> Future[bytes]:
        assert self._encoders is not None
        return self._encoders.submit(images.encode, name, image.copy())

    def _take_images(self, world: int, count: int) -> dict[str, list[bytes]]:
        taken = {name: worlds[world][:count] for name, worlds in self._images.items()}
        for worlds in self._images.values():
            del worlds[world][:count]
        return {name: [future.result() for future in futures] for name, futures in taken.items()}
