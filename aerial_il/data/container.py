"""MCAP files, written chunk by chunk so that a kill loses only the last one.

The records are those of the `mcap` package; only the hot path is our own: whole chunks of prepared message records.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from typing import BinaryIO

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

MAGIC = b"\x89MCAP0\r\n"
LIBRARY = "aerial_il"
COMPRESSION_LEVEL = 1


def record_bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


class ContainerWriter:
    """Appends records to an open file and closes it with an index.

    Args:
        file: opened for writing, at its beginning.
        schemas, channels: everything that messages will refer to.
    """

    def __init__(self, file: BinaryIO, schemas: Sequence[Schema], channels: Sequence[Channel]) -> None:
        self._file, self._crc, self._offset = file, 0, 0
        self._schemas, self._channels = tuple(schemas), tuple(channels)
        self._counts = {channel.id: 0 for channel in channels}
        self._times: list[int] = []
        self._indexes: dict[Opcode, list[McapRecord]] = {
            Opcode.ATTACHMENT_INDEX: [],
            Opcode.CHUNK_INDEX: [],
            Opcode.METADATA_INDEX: [],
        }
        self._compressor = zstandard.ZstdCompressor(level=COMPRESSION_LEVEL)
        self._put(MAGIC + record_bytes(Header("ros2", LIBRARY)))
        self._put(b"".join(record_bytes(record) for record in (*self._schemas, *self._channels)))

    def metadata(self, name: str, entries: dict[str, str]) -> None:
        """Append a metadata record."""
        raw = record_bytes(Metadata(name, entries))
        self._indexes[Opcode.METADATA_INDEX].append(MetadataIndex(self._offset, len(raw), name))
        self._put(raw)

    def attachment(self, name: str, media_type: str, data: bytes) -> None:
        """Append an attachment."""
        raw = record_bytes(Attachment(0, 0, name, media_type, data))
        index = AttachmentIndex(self._offset, len(raw), 0, 0, len(data), name, media_type)
        self._indexes[Opcode.ATTACHMENT_INDEX].append(index)
        self._put(raw)

    def chunk(
        self, content: bytes, channels: Sequence[int], times: np.ndarray, offsets: np.ndarray, *, compress: bool = True
    ) -> None:
        """Append one chunk of message records and hand it to the operating system.

        Args:
            content: the records, one after the other.
            channels: ids of the c channels that have messages in it.
            times: (k,) log times, ascending, in nanoseconds; each channel has one message at each of them.
            offsets: (c, k) where the records begin in ``content``.
            compress: False for content that is compressed already, such as images.
        """
        first, last = int(times[0]), int(times[-1])
        data, name = (self._compressor.compress(content), "zstd") if compress else (content, "")
        raw = record_bytes(Chunk(name, data, last, first, zlib.crc32(content), len(content)))
        index = _message_index(channels, times, offsets)
        starts = self._offset + len(raw) + np.arange(len(index)) * index.itemsize
        places = dict(zip(channels, starts.tolist(), strict=True))
        entry = ChunkIndex(len(raw), self._offset, name, len(data), last, index.nbytes, places, first, len(content))
        self._indexes[Opcode.CHUNK_INDEX].append(entry)
        for channel in channels:
            self._counts[channel] += len(times)
        self._times += [first, last]
        self._put(raw + index.tobytes())
        self._file.flush()

    def finish(self) -> None:
        """Write the end of the data section, the summary and the footer."""
        self._file.write(record_bytes(DataEnd(self._crc)))
        start = self._offset + len(record_bytes(DataEnd(0)))
        groups = {
            Opcode.SCHEMA: self._schemas,
            Opcode.CHANNEL: self._channels,
            Opcode.STATISTICS: [self._statistics()],
            **self._indexes,
        }
        summary, offsets = b"", b""
        for opcode, records in groups.items():
            group = b"".join(record_bytes(record) for record in records)
            if group:
                offsets += record_bytes(SummaryOffset(opcode, start + len(summary), len(group)))
            summary += group
        offset_start = start + len(summary)
        footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offset_start)
        self._file.write(summary + offsets + footer)
        self._file.write(struct.pack("<I", zlib.crc32(summary + offsets + footer)) + MAGIC)
        self._file.flush()

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._indexes[Opcode.ATTACHMENT_INDEX]),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._indexes[Opcode.CHUNK_INDEX]),
            message_count=sum(self._counts.values()),
            message_end_time=max(self._times, default=0),
            message_start_time=min(self._times, default=0),
            metadata_count=len(self._indexes[Opcode.METADATA_INDEX]),
            schema_count=len(self._schemas),
        )

    def _put(self, raw: bytes) -> None:
        self._file.write(raw)
        self._crc = zlib.crc32(raw, self._crc)
        self._offset += len(raw)


def _message_index(channels: Sequence[int], times: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Return the message index records of a chunk as a structured array (c,)."""
    entries = ("entries", "<u8", (len(times), 2))
    head = [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("size", "<u4")]
    index = np.zeros(len(channels), np.dtype([*head, entries]))
    index["opcode"], index["channel"] = Opcode.MESSAGE_INDEX, channels
    index["size"], index["length"] = 16 * len(times), 16 * len(times) + 6
    index["entries"][..., 0], index["entries"][..., 1] = times, offsets
    return index
