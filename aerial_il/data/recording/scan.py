"""Read an MCAP file without trusting a byte of it: every length bounded, every checksum compared.

One linear pass over the data section, as the index of a file that is being doubted proves nothing. Strict reading
accepts a whole file or raises; salvage keeps what lies before the first damage.
"""

from __future__ import annotations

import struct
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from io import BytesIO
from pathlib import Path

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, Metadata, Schema

from aerial_il.core.bounded import read_bytes
from aerial_il.core.errors import DemoError
from aerial_il.data.recording.container import MAGIC

MAX_FILE_BYTES = 4 << 30
MAX_DECOMPRESSED_BYTES = 160 << 20
MAX_MESSAGES = 500_000
MAX_DEFINITIONS = 1000  # schemas, channels, metadata records and attachments
RECOVER = "Salvage what it holds with: aerial-il recover path={}"
FOOTER_SIZE, MIN_MESSAGE = 29, 22
HEAD_SIZE = 11  # of a message: opcode, length and channel
_RECORD_HEAD = struct.Struct("<BQ")


class Stream:
    """The message records of one channel in file order, with their heads, in pieces of equal records."""

    def __init__(self) -> None:
        self._pieces: list[np.ndarray] = []
        self._count = 0

    def add(self, records: np.ndarray) -> None:
        """Append records (k, size) uint8."""
        self._pieces.append(records)
        self._count += len(records)

    def __len__(self) -> int:
        """Return the number of records."""
        return self._count

    def __iter__(self) -> Iterator[np.ndarray]:
        """Yield each record (size,)."""
        return (record for piece in self._pieces for record in piece)

    @property
    def last(self) -> np.ndarray:
        """The last record (size,), of those that are there."""
        return self._pieces[-1][-1]

    def first(self, count: int) -> Stream:
        """Return the stream of the first ``count`` records."""
        found = Stream()
        for piece in self._pieces:
            found.add(piece[: max(0, count - len(found))])
        return found

    def joined(self, size: int) -> np.ndarray:
        """Return all records as one array (k, size).

        Raises:
            ValueError: one has another size; :meth:`__iter__` finds it.
        """
        return np.concatenate([np.empty((0, size), np.uint8), *self._pieces])


@dataclass
class Contents:
    """The data section of one file.

    Attributes:
        profile: the header's profile.
        schemas, channels: by their ids.
        metadata, attachments: by their names.
        messages: for each channel id, its message records.
        damage: None for a whole file; for a salvaged one, what ended the reading.
    """

    profile: str = ""
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    messages: dict[int, Stream] = field(default_factory=lambda: defaultdict(Stream))
    damage: str | None = None


def scan(path: Path, *, salvage: bool = False) -> Contents:
    """Read all records of the MCAP file at ``path``.

    Args:
        path: the file.
        salvage: return what precedes the first damage instead of raising.

    Raises:
        DemoError: it is no MCAP file, cannot be read, or (unless ``salvage``) is truncated or damaged.
    """
    scanner = _Scanner(path)
    try:
        scanner.read_data_section()
        scanner.check_tail()
    except _DamageError as damage:
        if not salvage:
            raise DemoError(path, str(damage), hint=RECOVER.format(path)) from damage
        scanner.contents.damage = str(damage)
    return scanner.contents


class _DamageError(Exception):
    """The first fault of the file; bytes before it are sound."""


class _Scanner:
    def __init__(self, path: Path) -> None:
        self.contents = Contents()
        self._data = memoryview(_read_file(path))
        self._position = len(MAGIC)
        self._decompressed = self._count = self._defined = 0
        self._handlers: dict[int, Callable[[memoryview], None]] = {
            Opcode.HEADER: self._header,
            Opcode.SCHEMA: self._schema,
            Opcode.CHANNEL: self._channel,
            Opcode.METADATA: self._metadata,
            Opcode.ATTACHMENT: self._attachment,
            Opcode.CHUNK: self._chunk,
            Opcode.MESSAGE_INDEX: lambda body: None,
        }

    def read_data_section(self) -> None:
        """Read records up to and including the end of the data section."""
        while True:
            start = self._position
            opcode, body = self._next_record()
            if opcode == Opcode.DATA_END:
                return self._data_end(body, zlib.crc32(self._data[:start]))
            handler = self._handlers.get(opcode)
            self._defined += opcode not in (Opcode.CHUNK, Opcode.MESSAGE_INDEX)
            if self._defined > MAX_DEFINITIONS:
                raise _DamageError(f"has more than {MAX_DEFINITIONS} schemas, channels and other definitions.")
            if handler is None:
                raise _DamageError(f"has an unexpected record 0x{opcode:02x} at byte {start}.")
            try:
                handler(body)
            except (McapError, struct.error, ValueError, OverflowError, zstandard.ZstdError, IndexError) as error:
                raise _DamageError(f"has a malformed record 0x{opcode:02x} at byte {start} ({error!r}).") from error

    def _next_record(self) -> tuple[int, memoryview]:
        start, size = self._position, len(self._data)
        if start + 9 > size:
            raise _DamageError(f"is truncated at byte {size}.")
        opcode, length = _RECORD_HEAD.unpack_from(self._data, start)
        self._position = start + 9 + length
        if self._position > size:
            raise _DamageError(f"is truncated: a record at byte {start} of {length} bytes reaches past the end.")
        return opcode, self._data[start + 9 : self._position]

    def check_tail(self) -> None:
        """Check the summary and the footer, which no value is taken from but other tools rely on."""
        tail = self._data[self._position :]
        if len(tail) < FOOTER_SIZE + len(MAGIC) or tail[-len(MAGIC) :] != MAGIC:
            raise _DamageError("is truncated: its footer is missing.")
        footer = bytes(tail[-FOOTER_SIZE - len(MAGIC) : -len(MAGIC)])
        opcode, length, start, _, crc = struct.unpack("<BQQQI", footer)
        if (opcode, length, start) != (Opcode.FOOTER, 20, self._position):
            raise _DamageError("has a malformed footer.")
        if crc != zlib.crc32(tail[: -len(MAGIC) - 4]):
            raise _DamageError("fails the checksum of its summary.")

    def _data_end(self, body: memoryview, crc: int) -> None:
        if bytes(body) != struct.pack("<I", crc):
            raise _DamageError("fails the checksum of its data section.")

    def _header(self, body: memoryview) -> None:
        self.contents.profile = Header.read(_stream(body)).profile

    def _schema(self, body: memoryview) -> None:
        schema = _schema_of(bytes(body))
        _add(self.contents.schemas, schema.id, schema, "schema")

    def _channel(self, body: memoryview) -> None:
        channel = _channel_of(bytes(body))
        _add(self.contents.channels, channel.id, channel, "channel")

    def _metadata(self, body: memoryview) -> None:
        metadata = Metadata.read(_stream(body))
        _add(self.contents.metadata, metadata.name, metadata.metadata, "metadata")

    def _attachment(self, body: memoryview) -> None:
        if len(body) < 4 or struct.unpack("<I", body[-4:])[0] != zlib.crc32(body[:-4]):
            raise _DamageError("fails the checksum of an attachment.")
        attachment = Attachment.read(_stream(body))
        _add(self.contents.attachments, attachment.name, attachment.data, "attachment")

    def _chunk(self, body: memoryview) -> None:
        chunk = Chunk.read(_stream(body))
        content = memoryview(self._decompress(chunk))
        if zlib.crc32(content) != chunk.uncompressed_crc:
            raise _DamageError("fails the checksum of a chunk.")
        if not self._rows(content):
            self._records(content)

    def _rows(self, content: memoryview) -> bool:
        """Read a chunk in which each row of messages has the layout of the first; return False if it is another."""
        heads, position, channels = [], 0, set()
        while position + HEAD_SIZE <= len(content):
            opcode, length = _RECORD_HEAD.unpack_from(content, position)
            channel = content[position + 9] | content[position + 10] << 8
            if opcode != Opcode.MESSAGE or length < MIN_MESSAGE:
                return False
            if channel in channels:
                break
            heads.append((channel, position, position + 9 + length))
            channels.add(channel)
            position += 9 + length
        if not heads or len(content) % position:
            return False
        rows = np.frombuffer(content, np.uint8).reshape(-1, position)
        self._count_messages(len(rows) * len(heads))
        places = np.add.outer([start for _, start, _ in heads], np.arange(HEAD_SIZE)).ravel()
        if (rows[:, places] != rows[0, places]).any():
            return False
        for channel, start, end in heads:
            self.contents.messages[channel].add(rows[:, start:end])
        return True

    def _records(self, content: memoryview) -> None:
        """Read any chunk, record by record."""
        position, size = 0, len(content)
        while position < size:
            opcode, length = _RECORD_HEAD.unpack_from(content, position) if position + 9 <= size else (0, size)
            end = position + 9 + length
            if end > size:
                raise _DamageError("has a chunk with a record that reaches past its end.")
            if opcode == Opcode.MESSAGE and length >= MIN_MESSAGE:
                self._count_messages(1)
                channel = content[position + 9] | content[position + 10] << 8
                self.contents.messages[channel].add(np.frombuffer(content[position:end], np.uint8)[None])
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._handlers[opcode](content[position + 9 : end])
            else:
                raise _DamageError(f"has an unexpected record 0x{opcode:02x} inside a chunk.")
            position = end

    def _count_messages(self, count: int) -> None:
        """Refuse messages that are too many before an object is made of each; of those of a chunk, all at once."""
        self._count += count
        if self._count > MAX_MESSAGES:
            raise _DamageError(f"has more than {MAX_MESSAGES} messages.")

    def _decompress(self, chunk: Chunk) -> bytes:
        if chunk.compression == "":
            return chunk.data
        if chunk.compression != "zstd":
            raise _DamageError(f"has a chunk compressed with {chunk.compression!r}; zstd and none are read.")
        declared = zstandard.get_frame_parameters(chunk.data).content_size
        self._decompressed += max(declared, chunk.uncompressed_size)
        if declared != chunk.uncompressed_size or self._decompressed > MAX_DECOMPRESSED_BYTES:
            raise _DamageError(
                f"has a chunk that declares {declared} bytes, or in all more than {MAX_DECOMPRESSED_BYTES}."
            )
        return zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=declared)


def _read_file(path: Path) -> bytes:
    try:
        data = read_bytes(path, most=MAX_FILE_BYTES)
    except OSError as error:
        raise DemoError(path, f"cannot be read ({error.strerror}).") from error
    except ValueError as error:
        raise DemoError(path, f"cannot be read: {error}.") from error
    if data[: len(MAGIC)] != MAGIC:
        raise DemoError(path, "is not an MCAP file.", hint="List what a dataset holds with: aerial-il info path=FOLDER")
    return data


@lru_cache(maxsize=256)
def _schema_of(body: bytes) -> Schema:
    """Parse a schema, which all files of a dataset have in common."""
    return Schema.read(_stream(memoryview(body)))


@lru_cache(maxsize=256)
def _channel_of(body: bytes) -> Channel:
    """Parse a channel, likewise."""
    return Channel.read(_stream(memoryview(body)))


def _stream(body: memoryview) -> ReadDataStream:
    return ReadDataStream(BytesIO(body))


def _add(table: dict, key: object, value: object, kind: str) -> None:
    if table.setdefault(key, value) != value:
        raise _DamageError(f"has two different {kind} records {key!r}.")
