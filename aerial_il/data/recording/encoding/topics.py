"""Topics of fixed-size messages: which bytes of a step go into which slots, and what a whole MCAP record looks like."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

import numpy as np
from mcap.records import Channel, Schema

from aerial_il.data.recording.container import Definitions
from aerial_il.data.recording.encoding import messages
from aerial_il.data.recording.encoding.cdr import CdrTemplate
from aerial_il.data.recording.encoding.packing import Move, Packer

RECORD_HEAD = [
    ("opcode", "u1"),
    ("length", "<u8"),
    ("channel", "<u2"),
    ("sequence", "<u4"),
    ("log_time", "<u8"),
    ("publish_time", "<u8"),
]
RECORD_HEAD_SIZE = np.dtype(RECORD_HEAD).itemsize
MESSAGE_OPCODE = 5
MESSAGE_HEAD_SIZE = RECORD_HEAD_SIZE - 9  # what the record's length counts besides the body

ALL = slice(None)
STAMPS = {"sequence": "step", "log_time": "time_ns", "publish_time": "time_ns"}  # of a record's head

Block = Mapping[str, np.ndarray]
Sources = Mapping[str, tuple[str, slice]]
Extras = Mapping[str, tuple[str, ...]]
NO_EXTRAS: Extras = MappingProxyType({})


@dataclass(frozen=True)
class Topic:
    """A channel of a file, and what its messages are.

    Attributes:
        channel: MCAP channel id.
        name: topic name.
        type: ROS 2 message type.
    """

    channel: int
    name: str
    type: str


@dataclass(frozen=True)
class FixedTopic(Topic):
    """One topic of fixed-size messages.

    Attributes:
        template: the message's bytes and slots.
        sources: slot -> field of a step, and which of its columns; time stamps fill themselves.
    """

    template: CdrTemplate
    sources: Sources = field(repr=False)

    @cached_property
    def dtype(self) -> np.dtype:
        """Structured dtype of one MCAP message record: its head, then the ``body``."""
        return np.dtype([*RECORD_HEAD, ("body", self.template.dtype)])

    @cached_property
    def stamps(self) -> tuple[list[str], list[str]]:
        """Slots that hold seconds and nanoseconds."""
        names = self.template.dtype.names or ()
        return [n for n in names if n.startswith("sec")], [n for n in names if n.startswith("nanosec")]

    def expected(self, slot: str, block: Block | np.ndarray) -> np.ndarray:
        """Return what a slot holds (k, ...) in messages of the steps of ``block``."""
        name, columns = self.sources[slot]
        values = block[name] if columns == ALL else block[name][:, columns]
        return values.reshape(-1, *self.template.dtype[slot].shape)

    def moves(self, row: np.dtype) -> Iterator[Move]:
        """Yield which bytes of a step's ``row`` go where in a record."""
        for slot, name in STAMPS.items():
            yield _move(row, name, ALL, self.dtype, slot)
        seconds, nanoseconds = self.stamps
        stamps = {**dict.fromkeys(seconds, ("sec", ALL)), **dict.fromkeys(nanoseconds, ("nanosec", ALL))}
        for slot, (name, columns) in {**stamps, **self.sources}.items():
            source, target, size = _move(row, name, columns, self.template.dtype, slot)
            yield source, target + RECORD_HEAD_SIZE, size

    @cached_property
    def record_template(self) -> bytes:
        body = self.template.content
        head = np.zeros(1, RECORD_HEAD)
        head["opcode"], head["length"], head["channel"] = MESSAGE_OPCODE, MESSAGE_HEAD_SIZE + len(body), self.channel
        return head.tobytes() + body

    @cached_property
    def constant_mask(self) -> np.ndarray:
        """(size,) uint8: 255 for the bytes of a record that are the same in every message, its head left out."""
        mask = np.concatenate([np.zeros(RECORD_HEAD_SIZE, bool), self.template.constant_mask])
        return np.where(mask, 255, 0).astype(np.uint8)


@dataclass(frozen=True)
class Camera:
    """One image field and its topic of compressed images.

    Attributes:
        holds: whether it shows one image for several steps, which is then written once.
    """

    channel: int
    field: str
    shape: tuple[int, ...]
    dtype: str
    holds: bool = False

    @property
    def name(self) -> str:
        return f"/camera/{self.field}"

    @property
    def type(self) -> str:
        return messages.COMPRESSED_IMAGE

    @property
    def format(self) -> str:
        return "jpeg" if self.dtype == "uint8" else "png"

    @cached_property
    def template(self) -> CdrTemplate:
        return messages.compressed_image(self.field, self.format)


def packer_of(topics: Sequence[FixedTopic], row: np.dtype) -> Packer:
    """Return what makes of each step, a ``row``, the records of ``topics``, in their order."""
    starts = np.cumsum([0, *(len(topic.record_template) for topic in topics)]).tolist()
    moves = [
        (source, start + target, size)
        for topic, start in zip(topics, starts[:-1], strict=True)
        for source, target, size in topic.moves(row)
    ]
    return Packer(b"".join(topic.record_template for topic in topics), moves)


def definitions_of(topics: Sequence[Topic | Camera]) -> Definitions:
    """Return the MCAP schema and channel records of topics."""
    ids = {name: i for i, name in enumerate(sorted({topic.type for topic in topics}), 1)}
    schemas = [Schema(i, messages.definition(name).encode(), "ros2msg", name) for name, i in ids.items()]
    channels = [Channel(topic.channel, topic.name, "cdr", {}, ids[topic.type]) for topic in topics]
    return Definitions(tuple(schemas), tuple(channels))


def nanoseconds(sim_time: np.ndarray) -> np.ndarray:
    """Return simulation time in whole nanoseconds, as MCAP stamps it."""
    return np.round(np.asarray(sim_time) * 1e9).astype(np.uint64)


def place_of(struct: np.dtype, name: str) -> tuple[np.dtype, int]:
    """Return the dtype and the first byte of a field of a structured dtype."""
    fields = {str(key): value for key, value in (struct.fields or {}).items()}
    return fields[name][0], fields[name][1]


def _move(row: np.dtype, name: str, columns: slice, record: np.dtype, slot: str) -> Move:
    """Return which bytes of ``row`` fill ``slot`` of ``record``."""
    (kind, source), (filled, target) = place_of(row, name), place_of(record, slot)
    first, last, _ = columns.indices(kind.shape[0] if kind.shape else 1)
    size = kind.base.itemsize
    assert (last - first) * size == filled.itemsize, (name, slot)
    return source + first * size, target, filled.itemsize
