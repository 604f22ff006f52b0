"""Write one episode as one MCAP file, appended to while it is flown."""

import fcntl
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, BinaryIO

import numpy as np

from aerial_il.core.errors import InvalidValueError, StorageError
from aerial_il.data.episode import Episode
from aerial_il.data.recording.container import ContainerWriter
from aerial_il.data.recording.encoding.columns import MOST_STEPS
from aerial_il.data.recording.encoding.digest import ContentDigest
from aerial_il.data.recording.encoding.images import encode
from aerial_il.data.recording.encoding.topics import (
    MESSAGE_HEAD_SIZE,
    MESSAGE_OPCODE,
    RECORD_HEAD,
    Block,
    Camera,
    nanoseconds,
)
from aerial_il.data.recording.form import STEP, form_of
from aerial_il.data.recording.schema import VERSION, Layout

STEPS_PER_CHUNK = MOST_STEPS  # written at once; what a kill loses: 1.3 s at 50 Hz
CHUNK_BYTES = 1 << 20  # at most, unless a step is larger
EPISODE, PROVENANCE, OUTCOME = "aerial_il.episode", "aerial_il.provenance", "aerial_il.outcome"
MODEL = "model.xml"
FULL_DISK_HINT = "Finished episodes are intact: free some space and run the same command again."

Images = Mapping[str, Sequence[bytes]]
NO_IMAGES: Images = MappingProxyType({})
NOTHING: Mapping[str, Any] = MappingProxyType({})


class BusyError(Exception):
    """Another process is writing the same episode."""


class EpisodeWriter:
    """One episode on its way to the disk, under the name ``<path>.part`` until it is finished.

    Equal calls give equal bytes: time stamps are simulation time, and wall time is left out. Making one
    only creates and locks the file; all else may be done by another thread, one call after the other.

    Args:
        path: the file to be; a left-over ``.part`` of a killed process is overwritten.
        layout: what the environment records.
        uid: the episode's name.
        provenance: JSON values.
        model_xml: the compiled scene.

    Raises:
        BusyError: another process holds the ``.part`` file.
        StorageError: the folder cannot be written or the disk is full; so do all methods.
    """

    def __init__(self, path: Path, layout: Layout, *, uid: str, provenance: Mapping[str, Any], model_xml: str) -> None:
        self.path, self.part = Path(path), part_of(path)
        self._layout, self._uid, self._provenance = layout, uid, provenance
        self._form = form_of(layout)
        self._steps, self._digest = 0, ContentDigest()
        self._viewed: list[np.ndarray] = []
        self._rows_per_chunk = max(1, min(STEPS_PER_CHUNK, CHUNK_BYTES // layout.row.itemsize))
        self._attachments = {MODEL: model_xml.encode()}
        self._metadata: dict[str, dict[str, str]] = {}
        with storing(self.part):
            self._file = _open_locked(self.part)

    def append(self, block: Block | np.ndarray, images: Images = NO_IMAGES) -> None:
        """Append k steps, and their images as chunks of their own.

        Args:
            block: fields of :attr:`Layout.row` by name, each (k, ...); or the rows (k,) themselves.
            images: for each camera field, k compressed images.

        Raises:
            SimulationDivergedError: a value is not finite.
        """
        rows = self._rows(block)
        self._put(rows, images)
        self._view(rows)
        self._steps += len(rows)

    def finish(
        self,
        rest: Block | np.ndarray,
        images: Images = NO_IMAGES,
        *,
        success: bool,
        path: Path | None = None,
        note: str = "",
        made_of: Mapping[str, Any] = NOTHING,
    ) -> Path:
        """Append what is left, and give the file its name.

        Args:
            rest: as in :meth:`append`, k steps more and one that ends the flight, of which ``sim_time``,
                ``observation`` and ``state`` count.
            images: for each camera field, k + 1 compressed images.
            success: whether the task was solved.
            path: where it goes instead of ``self.path``.
            note: what is special about it, e.g. that it was salvaged.
            made_of: JSON values that are known only in the end, for its provenance: what a generated flight came from.
        """
        rows = self._rows(rest)
        self._layout.numbers(rows)[-1, self._layout.seen_width :] = 0.0
        self._put(rows, images)
        self._view(rows[:-1])
        self._steps += len(rows) - 1
        with storing(self.part):
            self._put_views()
            outcome = {"success": json.dumps(bool(success)), "steps": str(self._steps), "note": note}
            if made_of:
                outcome["made_of"] = json.dumps(dict(made_of), sort_keys=True)
            digest = self._digest.hexdigest({**self._metadata, OUTCOME: outcome}, self._attachments)
            self._container.metadata(OUTCOME, {**outcome, "digest": digest})
            self._container.finish()
            os.fsync(self._file.fileno())
            path = Path(path or self.path)
            path.parent.mkdir(parents=True, exist_ok=True)
            os.replace(self.part, path)  # a power cut before the folder is synced leaves the .part file, whole
            self._file.close()
        return path

    @property
    def sha256(self) -> str:
        """Of the file as far as it is written."""
        return self._container.sha256

    def discard(self) -> None:
        """Forget the episode."""
        self.part.unlink(missing_ok=True)
        self.abandon()

    def abandon(self) -> None:
        """Close the ``.part`` file and leave it for recovery."""
        with suppress(OSError):  # a full disk was reported where it was met
            self._file.close()

    @cached_property
    def _container(self) -> ContainerWriter:
        """The file's records, of which those that precede all messages are written when it is first asked for."""
        head = {"schema_version": str(VERSION), "uid": self._uid, "ctrl_size": str(self._layout.ctrl_size)}
        extras = {"extras": json.dumps(self._layout.extras)} if self._layout.extras else {}
        self._metadata = {
            EPISODE: {**head, "spec": self._layout.spec_json, "columns": self._layout.columns_json, **extras},
            PROVENANCE: {key: json.dumps(value, sort_keys=True) for key, value in self._provenance.items()},
        }
        container = ContainerWriter(self._file, self._form.definitions)
        for name, entries in self._metadata.items():
            container.metadata(name, entries)
        container.attachment(MODEL, "application/xml", self._attachments[MODEL])
        return container

    def _rows(self, block: Block | np.ndarray) -> np.ndarray:
        return block if isinstance(block, np.ndarray) else self._layout.rows(block)

    def _view(self, rows: np.ndarray) -> None:
        """Keep for the end what people will look at: it is said again, so a kill costs nothing."""
        self._viewed.append(self._form.viewed(rows, self._steps))

    def _put(self, rows: np.ndarray, images: Images) -> None:
        with storing(self.part):
            for start in range(0, len(rows), self._rows_per_chunk):
                chosen = slice(start, start + self._rows_per_chunk)
                self._put_steps(rows[chosen], self._steps + start)
                if self._form.cameras:
                    taken = {name: data[chosen] for name, data in images.items()}
                    self._put_images(nanoseconds(rows["sim_time"][chosen]), self._steps + start, taken)

    def _put_steps(self, rows: np.ndarray, first: int) -> None:
        record = self._form.step_record(rows, first, seed=int(self._provenance.get("seed", -1)))
        self._digest.update(STEP, record)
        time = nanoseconds(rows["sim_time"][:1])
        self._container.chunk(record, [self._form.step.channel], time, np.zeros((1, 1), np.int64))

    def _put_views(self) -> None:
        """Write what people look at, all of it at once."""
        viewed, topics = np.concatenate(self._viewed), self._form.views
        records, starts = self._form.view_records(viewed), self._form.view_starts.tolist()
        for topic, start in zip(topics, starts, strict=True):
            columns = records[:, start : start + len(topic.record_template)]
            self._digest.update(topic.name, np.ascontiguousarray(columns))
        most = max(1, CHUNK_BYTES // records.shape[1])
        for first in range(0, len(records), most):
            part, times = records[first : first + most], viewed["time_ns"][first : first + most]
            offsets = np.add.outer(starts, np.arange(len(part)) * part.shape[1])
            self._container.chunk(part, [topic.channel for topic in topics], times, offsets)

    def _put_images(self, times: np.ndarray, first: int, images: Images) -> None:
        together = [camera for camera in self._form.cameras if not camera.holds]
        if together:
            self._put_chosen(together, range(len(times)), times, first, images)
        for camera in self._form.cameras:
            if camera.holds:
                self._put_chosen([camera], _new_ones(images[camera.field]), times, first, images)

    def _put_chosen(
        self, cameras: Sequence[Camera], chosen: Sequence[int], times: np.ndarray, first: int, images: Images
    ) -> None:
        records: list[bytes] = []
        for camera in cameras:
            mine = [image_record(camera, first + i, int(times[i]), images[camera.field][i]) for i in chosen]
            self._digest.update(camera.name, b"".join(mine))
            records += mine
        offsets = np.cumsum([0, *map(len, records[:-1])]).reshape(len(cameras), -1)
        channels = [camera.channel for camera in cameras]
        self._container.chunk(b"".join(records), channels, times[chosen], offsets, compress=False)


def write_episode(episode: Episode, path: Path) -> Path:
    """Write an episode that is in memory, wherever it came from; its images are left out unless they were decoded.

    Raises:
        BusyError: another process writes it.
        InvalidValueError: the episode lacks the images that its specification promises.
        StorageError: the disk is full or the folder not writable.
    """
    layout = Layout(episode.spec, episode.ctrl.shape[1], episode.extra_labels)
    cameras = form_of(layout).cameras
    for camera in cameras:
        if camera.field not in episode.obs:
            raise InvalidValueError(f"Episode {episode.uid} was read without its images of {camera.field}.")
    pictures = {c.field: [encode(image) for image in episode.obs[c.field]] for c in cameras}
    writer = EpisodeWriter(path, layout, uid=episode.uid, provenance=episode.provenance, model_xml=episode.model_xml)
    return writer.finish(_block(episode), pictures, success=episode.success)


def _block(episode: Episode) -> dict[str, np.ndarray]:
    return {
        "sim_time": episode.sim_time,
        "observation": episode.flat_obs(episode.spec.observation.state_names),
        "state": episode.states,
        "ctrl": episode.ctrl,
        "action": episode.actions,
        "executed_action": episode.executed_actions,
        "expert_action": episode.expert_actions,
        "is_intervention": episode.is_intervention,
        "phase": episode.phase,
        "reward": episode.rewards,
        "terminated": episode.terminated,
        "truncated": episode.truncated,
        **episode.extras,
    }


def _new_ones(images: Sequence[bytes]) -> list[int]:
    """Return which images differ from the one before, and the last one, which says how far they reach."""
    last = len(images) - 1
    return [i for i in range(len(images)) if i in (0, last) or images[i] != images[i - 1]]


def part_of(path: str | os.PathLike[str]) -> Path:
    """Return the name a file has while it is being written."""
    path = Path(path)
    return path.with_name(path.name + ".part")


def is_being_written(part: Path) -> bool:
    """Return whether a living process holds a ``.part`` file."""
    with open(part, "rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


def image_record(camera: Camera, sequence: int, time_ns: int, data: bytes) -> bytes:
    """Return the MCAP message record of one compressed image."""
    body = np.frombuffer(bytearray(camera.template.content), camera.template.dtype)
    body["sec"], body["nanosec"], body["size"] = time_ns // 10**9, time_ns % 10**9, len(data)
    length = MESSAGE_HEAD_SIZE + body.nbytes + len(data)
    head = np.array([(MESSAGE_OPCODE, length, camera.channel, sequence, time_ns, time_ns)], RECORD_HEAD)
    return head.tobytes() + body.tobytes() + data


def _open_locked(part: Path) -> BinaryIO:
    part.parent.mkdir(parents=True, exist_ok=True)
    file = open(part, "ab")  # noqa: SIM115 - it stays open and locked while the episode is flown
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if not part.exists() or os.fstat(file.fileno()).st_ino != part.stat().st_ino:
            raise BlockingIOError  # its owner finished and renamed it in between
    except BlockingIOError:
        file.close()
        raise BusyError(f"{part} is being written by another process.") from None
    if os.fstat(file.fileno()).st_size:
        file.truncate(0)
    return file


@contextmanager
def storing(path: Path) -> Iterator[None]:
    """Turn the operating system's refusals while writing ``path`` into a :class:`StorageError`."""
    try:
        yield
    except OSError as error:
        raise StorageError(path, error, FULL_DISK_HINT) from error
