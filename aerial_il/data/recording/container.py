"""MCAP files, written chunk by chunk so that a kill loses only the last one.

The records are those of the `mcap` package; only the hot path is our own: whole chunks of prepared message records.
"""

import hashlib
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import BinaryIO

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
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
COMPRESSION_LEVEL = -3  # two thirds of the time of level 1, for files 1 to 2 % larger
CHUNK_HEAD = struct.Struct("<BQQQQI")  # opcode, length, first and last time, size and CRC of the content

Content = bytes | np.ndarray


def record_bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


@dataclass(frozen=True)
class Definitions:
    """Everything that messages refer to: the same in every file of an environment.

    Attributes:
        schemas, channels: the records.
    """

    schemas: tuple[Schema, ...]
    channels: tuple[Channel, ...]

    @cached_property
    def schema_bytes(self) -> bytes:
        return b"".join(map(record_bytes, self.schemas))

    @cached_property
    def channel_bytes(self) -> bytes:
        return b"".join(map(record_bytes, self.channels))


class ContainerWriter:
    """Appends records to an open file and closes it with an index.

    Args:
        file: opened for writing, at its beginning.
        definitions: what messages will refer to.
    """

    def __init__(self, file: BinaryIO, definitions: Definitions) -> None:
        self._file, self._crc, self._offset = file, 0, 0
        self._definitions, self._sha256 = definitions, hashlib.sha256()
        self._counts = {channel.id: 0 for channel in definitions.channels}
        self._times: list[int] = []
        self._indexes: dict[Opcode, list[McapRecord]] = {
            Opcode.ATTACHMENT_INDEX: [],
            Opcode.CHUNK_INDEX: [],
            Opcode.METADATA_INDEX: [],
        }
        self._compressor = zstandard.ZstdCompressor(level=COMPRESSION_LEVEL)
        self._put(MAGIC + record_bytes(Header("ros2", LIBRARY)))
        self._put(definitions.schema_bytes + definitions.channel_bytes)

    @property
    def sha256(self) -> str:
        """Of all bytes so far."""
        return self._sha256.hexdigest()

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
        self,
        content: Content,
        channels: Sequence[int],
        times: np.ndarray,
        offsets: np.ndarray,
        *,
        compress: bool = True,
    ) -> None:
        """Append one chunk of message records and hand it to the operating system.

        Args:
            content: the records, one after the other; an array is contiguous.
            channels: ids of the c channels that have messages in it.
            times: (k,) log times, ascending, in nanoseconds; each channel has one message at each of them.
            offsets: (c, k) where the records begin in ``content``.
            compress: False for content that is compressed already, such as images.
        """
        first, last, size = int(times[0]), int(times[-1]), memoryview(content).nbytes
        data, name = (self._compressor.compress(memoryview(content)), b"zstd") if compress else (bytes(content), b"")
        rest = struct.pack(f"<I{len(name)}sQ", len(name), name, len(data))
        length = CHUNK_HEAD.size - 9 + len(rest) + len(data)
        head = CHUNK_HEAD.pack(Opcode.CHUNK, length, first, last, size, zlib.crc32(content)) + rest
        index, start = _message_index(channels, times, offsets), self._offset
        self._put(b"".join((head, data, index.tobytes())))  # at once: small writes cost more than copies
        begin = start + len(head) + len(data)
        places = dict(zip(channels, range(begin, self._offset, index.itemsize), strict=True))
        entry = ChunkIndex(
            len(head) + len(data), start, name.decode(), len(data), last, index.nbytes, places, first, size
        )
        self._indexes[Opcode.CHUNK_INDEX].append(entry)
        for channel in channels:
            self._counts[channel] += len(times)
        self._times += [first, last]
        self._file.flush()

    def finish(self) -> None:
        """Write the end of the data section, the summary and the footer."""
        self._put(record_bytes(DataEnd(self._crc)))
        start = self._offset
        groups = {
            Opcode.SCHEMA: self._definitions.schema_bytes,
            Opcode.CHANNEL: self._definitions.channel_bytes,
            Opcode.STATISTICS: record_bytes(self._statistics()),
            **{opcode: b"".join(map(record_bytes, records)) for opcode, records in self._indexes.items()},
        }
        summary, offsets = b"", b""
        for opcode, group in groups.items():
            if group:
                offsets += record_bytes(SummaryOffset(opcode, start + len(summary), len(group)))
            summary += group
        footer = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, start + len(summary))
        self._put(summary + offsets + footer)
        self._put(struct.pack("<I", zlib.crc32(summary + offsets + footer)) + MAGIC)
        self._file.flush()

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._indexes[Opcode.ATTACHMENT_INDEX]),
            channel_count=len(self._definitions.channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._indexes[Opcode.CHUNK_INDEX]),
            message_count=sum(self._counts.values()),
            message_end_time=max(self._times, default=0),
            message_start_time=min(self._times, default=0),
            metadata_count=len(self._indexes[Opcode.METADATA_INDEX]),
            schema_count=len(self._definitions.schemas),
        )

    def _put(self, raw: bytes) -> None:
        self._file.write(raw)
        self._crc = zlib.crc32(raw, self._crc)
        self._sha256.update(raw)
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
