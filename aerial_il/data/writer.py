"""Write one episode as one MCAP file, appended to while it is flown."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any, BinaryIO

import numpy as np
from mcap.records import Channel, Schema

from aerial_il.core.errors import InvalidValueError, SimulationDivergedError, StorageError
from aerial_il.data import messages
from aerial_il.data.container import ContainerWriter
from aerial_il.data.digest import ContentDigest
from aerial_il.data.episode import Episode
from aerial_il.data.images import encode
from aerial_il.data.schema import MESSAGE_HEAD_SIZE, MESSAGE_OPCODE, RECORD_HEAD, VERSION, Block, Camera, Layout

CHUNK_BYTES = 64 * 1024
EPISODE, PROVENANCE, OUTCOME = "aerial_il.episode", "aerial_il.provenance", "aerial_il.outcome"
MODEL = "model.xml"
FULL_DISK_HINT = "Finished episodes are intact: free some space and run the same command again."

Images = Mapping[str, Sequence[bytes]]
NO_IMAGES: Images = MappingProxyType({})


class BusyError(Exception):
    """Another process is writing the same episode."""


class EpisodeWriter:
    """One episode on its way to the disk, under the name ``<path>.part`` until it is finished.

    Equal calls give equal bytes: time stamps are simulation time, and wall time is nobody's business here.

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
        self._layout, self._seed = layout, int(provenance.get("seed", -1))
        self._steps, self._digest = 0, ContentDigest()
        self._channels = {topic.name: topic.channel for topic in layout.topics}
        self._rows_per_chunk = max(1, CHUNK_BYTES // layout.step_bytes)
        self._attachments = {MODEL: model_xml.encode()}
        head = {"schema_version": str(VERSION), "uid": uid, "ctrl_size": str(layout.ctrl_size)}
        self._metadata = {
            EPISODE: {**head, "spec": json.dumps(layout.spec.to_dict(), allow_nan=False)},
            PROVENANCE: {key: json.dumps(value, sort_keys=True) for key, value in provenance.items()},
        }
        with storing(self.part):
            self._file = _open_locked(self.part)
            self._container = ContainerWriter(self._file, *schemas_and_channels(layout))
            for name, entries in self._metadata.items():
                self._container.metadata(name, entries)
            self._container.attachment(MODEL, "application/xml", self._attachments[MODEL])
            self._file.flush()

    def append(self, block: Block, images: Images = NO_IMAGES) -> None:
        """Append k steps as chunks of 64 KiB, and their images as one more.

        Args:
            block: ``sim_time`` (k,), ``observation`` (k, Do) flat, ``reward`` (k,) and the fields of ``Step``.
            images: for each camera field, k compressed images.

        Raises:
            SimulationDivergedError: a value is not finite.
        """
        self._require_finite(block)
        count = len(block["sim_time"])
        self._put(self._layout.steps(self._with_counters(block, count), self._steps), images)
        self._steps += count

    def finish(
        self, last: Block, images: Images = NO_IMAGES, *, success: bool, path: Path | None = None, note: str = ""
    ) -> Path:
        """Append the terminal record and give the file its name.

        Args:
            last: a block of one step with ``sim_time``, ``observation`` and ``state`` after the last step.
            images: for each camera field, one compressed image.
            success: whether the task was solved.
            path: where it goes instead of ``self.path``.
            note: what is special about it, e.g. that it was salvaged.
        """
        self._require_finite(last)
        self._put(self._layout.last(self._with_counters(last, 1), self._steps), images)
        outcome = {"success": json.dumps(bool(success)), "steps": str(self._steps), "note": note}
        digest = self._digest.hexdigest({**self._metadata, OUTCOME: outcome}, self._attachments)
        path = Path(path or self.path)
        with storing(self.part):
            self._container.metadata(OUTCOME, {**outcome, "digest": digest})
            self._container.finish()
            os.fsync(self._file.fileno())
            path.parent.mkdir(parents=True, exist_ok=True)
            os.replace(self.part, path)  # a power cut before the folder is synced leaves the .part file, whole
            self._file.close()
        return path

    def discard(self) -> None:
        """Forget the episode."""
        self.part.unlink(missing_ok=True)
        self.abandon()

    def abandon(self) -> None:
        """Close the ``.part`` file and leave it for recovery."""
        with suppress(OSError):  # a full disk was reported where it was met
            self._file.close()

    def _put(self, records: np.ndarray, images: Images) -> None:
        for name in records.dtype.names or ():
            self._digest.update(name, records[name].tobytes())
        with storing(self.part):
            for start in range(0, len(records), self._rows_per_chunk):
                self._put_chunk(records[start : start + self._rows_per_chunk])
            if self._layout.cameras:
                self._put_images(records["/observation"]["log_time"], images)

    def _put_chunk(self, records: np.ndarray) -> None:
        first = [records.dtype.fields[name][1] for name in records.dtype.names]
        offsets = np.add.outer(first, np.arange(len(records)) * records.dtype.itemsize)
        channels = [self._channels[name] for name in records.dtype.names]
        self._container.chunk(records.tobytes(), channels, records["/observation"]["log_time"], offsets)

    def _put_images(self, times: np.ndarray, images: Images) -> None:
        records = []
        for camera in self._layout.cameras:
            pairs = zip(times.tolist(), images[camera.field], strict=True)
            mine = [image_record(camera, self._steps + i, time, data) for i, (time, data) in enumerate(pairs)]
            self._digest.update(camera.name, b"".join(mine))
            records += mine
        offsets = np.cumsum([0, *map(len, records[:-1])]).reshape(len(self._layout.cameras), -1)
        channels = [camera.channel for camera in self._layout.cameras]
        self._container.chunk(b"".join(records), channels, times, offsets, compress=False)

    def _with_counters(self, block: Block, count: int) -> Block:
        return {**block, "step": np.arange(self._steps, self._steps + count)}

    def _require_finite(self, block: Block) -> None:
        for name in ("observation", "state", "action", "executed_action", "ctrl", "reward", "sim_time"):
            bad = ~np.isfinite(block[name]) if name in block else np.zeros(1, bool)
            if bad.any():
                where = tuple(int(i) for i in np.argwhere(bad)[0])
                raise SimulationDivergedError(
                    f"{name}{list(where[1:])} is not finite", seed=self._seed, step=self._steps + where[0]
                )


def write_episode(episode: Episode, path: Path) -> Path:
    """Write an episode that is in memory, wherever it came from; its images are left out unless they were decoded.

    Raises:
        BusyError: another process writes it.
        InvalidValueError: the episode lacks the images that its specification promises.
        StorageError: the disk is full or the folder not writable.
    """
    layout = Layout(episode.spec, episode.ctrl.shape[1])
    for camera in layout.cameras:
        if camera.field not in episode.obs:
            raise InvalidValueError(f"Episode {episode.uid} was read without its images of {camera.field}.")
    pictures = {c.field: [encode(c.field, image) for image in episode.obs[c.field]] for c in layout.cameras}
    writer = EpisodeWriter(path, layout, uid=episode.uid, provenance=episode.provenance, model_xml=episode.model_xml)
    block = _block(episode)
    steps = {name: values[: len(episode)] for name, values in block.items()}
    writer.append(steps, {name: images[:-1] for name, images in pictures.items()})
    last = {name: block[name][-1:] for name in ("sim_time", "observation", "state")}
    return writer.finish(last, {name: images[-1:] for name, images in pictures.items()}, success=episode.success)


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
    }


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


def schemas_and_channels(layout: Layout) -> tuple[list[Schema], list[Channel]]:
    """Return the MCAP schema and channel records of a layout."""
    types = sorted({t.type for t in layout.topics} | ({messages.COMPRESSED_IMAGE} if layout.cameras else set()))
    ids = {name: i for i, name in enumerate(types, 1)}
    schemas = [Schema(i, messages.definition(name).encode(), "ros2msg", name) for name, i in ids.items()]
    channels = [Channel(t.channel, t.name, "cdr", {}, ids[t.type]) for t in layout.topics]
    images = [Channel(c.channel, c.name, "cdr", {}, ids[messages.COMPRESSED_IMAGE]) for c in layout.cameras]
    return schemas, channels + images


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
