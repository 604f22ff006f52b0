"""Whatever a file has become, reading it gives the identical episode or a typed error: no crash, no silent pass."""

import json
import resource
import struct
import tracemalloc
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.records import Message
from mcap.writer import CompressionType, Writer

from aerial_il.core.errors import DemoError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.recording.container import MAGIC, record_bytes
from aerial_il.data.recording.encoding import columns
from aerial_il.data.recording.form import Form
from aerial_il.data.recording.reader import read_episode
from aerial_il.data.recording.schema import Layout
from tests.data.crane import crane_spec
from tests.data.tampering import Entries, rewrite

LAYOUT = Layout(crane_spec(), 2)
HEAD = struct.Struct("<BQHIQQ")  # of a message record


def episodes_equal(a, b) -> bool:
    names = [
        "actions",
        "executed_actions",
        "expert_actions",
        "states",
        "ctrl",
        "sim_time",
        "rewards",
        "phase",
        "terminated",
        "truncated",
    ]
    same = all(np.array_equal(getattr(a, n), getattr(b, n), equal_nan=True) for n in names)
    same &= all(np.array_equal(a.obs[n], b.obs[n]) for n in a.spec.observation.names)
    return same and (a.uid, a.success, a.model_xml, a.provenance) == (b.uid, b.success, b.model_xml, b.provenance)


def test_every_truncation_is_found(demo: Path, tmp_path: Path) -> None:
    raw, target = demo.read_bytes(), tmp_path / "cut.mcap"
    for length in [*range(60), *np.linspace(60, len(raw) - 1, 150).astype(int)]:
        target.write_bytes(raw[:length])
        with pytest.raises(DemoError, match=r"truncated|not an MCAP file|footer") as caught:
            read_episode(target)
        assert str(target) in str(caught.value)
    target.write_bytes(raw[: len(raw) // 2])
    with pytest.raises(DemoError, match="aerial-il recover"):
        read_episode(target)


@pytest.mark.parametrize("kind", ["bit", "bytes", "zeros", "insert", "delete", "swap"])
def test_random_mutations(demo: Path, tmp_path: Path, kind: str) -> None:
    raw, whole, rng = demo.read_bytes(), read_episode(demo), np.random.default_rng([7, len(kind)])
    target = tmp_path / "mutated.mcap"
    tracemalloc.start()
    for _ in range(80):
        target.write_bytes(mutate(raw, kind, rng))
        try:
            episode = read_episode(target)
        except DemoError as error:
            refused, episode = str(error), whole
            assert str(target) in refused
        assert episodes_equal(episode, whole)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 20 * len(raw) + (50 << 20), "damage must not make the reader ask for much more than a sound file does"


def mutate(raw: bytes, kind: str, rng: np.random.Generator) -> bytes:
    data = bytearray(raw)
    start, size = int(rng.integers(len(raw))), int(rng.integers(1, 200))
    if kind == "bit":
        data[start] ^= 1 << int(rng.integers(8))
    elif kind == "bytes":
        data[start : start + size] = rng.bytes(len(data[start : start + size]))
    elif kind == "zeros":
        data[start : start + size] = bytes(len(data[start : start + size]))
    elif kind == "insert":
        data[start:start] = rng.bytes(size)
    elif kind == "delete":
        del data[start : start + size]
    else:
        other = int(rng.integers(len(raw)))
        data[start : start + size], data[other : other + size] = data[other : other + size], data[start : start + size]
    return bytes(data)


def test_a_copy_by_another_tool_is_accepted(demo: Path, tmp_path: Path) -> None:
    """The digest covers what is said, not how it is cut into chunks."""
    for compression in (CompressionType.ZSTD, CompressionType.NONE):
        copy = rewrite(demo, tmp_path / "copy.mcap", compression=compression)
        assert episodes_equal(read_episode(copy), read_episode(demo))


def with_step(field: str, step: int, value: object) -> Callable[[str, Message], Message]:
    """Change one field of one step."""

    def change(topic: str, message: Message) -> Message:
        if topic == "/step" and message.sequence == 0:
            head = HEAD.pack(5, 22 + len(message.data), 1, 0, message.log_time, message.publish_time)
            steps = columns.from_record(np.frombuffer(head + message.data, np.uint8), LAYOUT.width)
            steps.numbers.view(LAYOUT.row)[field][step] = value
            record = columns.to_record(1, steps, 0)
            assert record is not None
            message.data = record[HEAD.size :]
        return message

    return change


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("action", np.nan, "topic /step, step 3, field action"),
        ("state", np.inf, "topic /step, step 3, field state"),
        ("action", 1e3, "topic /step, step 3, field action"),
        ("executed_action", np.nan, "topic /step, step 3"),
        ("expert_action", [np.nan, 1.0], "topic /step, step 3, field expert_action"),
        ("sim_time", 7.0, "topic /step, step 3, field sim_time"),
        ("terminated", 1, "topic /step, step 3, field terminated"),
        ("truncated", 1, "topic /step, step 3, field truncated"),
        ("state", 1.0, "changed after it was recorded"),
        ("ctrl", 0.5, "changed after it was recorded"),
        ("phase", 1000, "changed after it was recorded"),
    ],
)
def test_changed_values_are_named(demo: Path, tmp_path: Path, field: str, value: object, says: str) -> None:
    path = rewrite(demo, tmp_path / "changed.mcap", message=with_step(field, 3, value))
    with pytest.raises(DemoError, match=says):
        read_episode(path)


def drop(topic: str, sequence: int | None = None) -> Callable[[str, Message], Message | None]:
    return lambda t, m: None if t == topic and sequence in (None, m.sequence) else m


@pytest.mark.parametrize("topic", ["/step", *(topic.name for topic in Form(LAYOUT).views)])
def test_missing_topics_and_messages_are_named(demo: Path, tmp_path: Path, topic: str) -> None:
    with pytest.raises(DemoError, match=f"topic {topic}"):
        read_episode(rewrite(demo, tmp_path / "without.mcap", message=drop(topic)))
    if topic != "/step":
        with pytest.raises(DemoError, match=f"topic {topic}"):
            read_episode(rewrite(demo, tmp_path / "gap.mcap", message=drop(topic, 5)))


def test_time_and_order_are_checked(demo: Path, tmp_path: Path) -> None:
    def later(topic: str, message: Message) -> Message:
        message.log_time += 5 if (topic, message.sequence) == ("/action", 5) else 0
        return message

    def renumber(topic: str, message: Message) -> Message:
        message.sequence += 1 if topic == "/reward" else 0
        return message

    def longer(topic: str, message: Message) -> Message:
        message.data += b"\0" * 8 if topic == "/action" and message.sequence == 5 else b""
        return message

    def renamed(topic: str, message: Message) -> Message:
        message.data = message.data.replace(b"swing", b"twist")
        return message

    for change, says in (
        (later, "topic /action, step 5"),
        (renumber, "topic /reward, step 0, field sequence"),
        (longer, "topic /action, step 5"),
        (renamed, "differs from its specification. .topic /observation, step 0"),
    ):
        with pytest.raises(DemoError, match=says):
            read_episode(rewrite(demo, tmp_path / "changed.mcap", message=change))


def edit(name: str, **changes: str | None) -> Callable[[Entries], Entries]:
    """Change or (None) remove entries of one metadata record."""

    def change(entries: Entries) -> Entries:
        merged = {**entries[name], **changes}
        return {**entries, name: {k: v for k, v in merged.items() if v is not None}}

    return change


SPEC = json.dumps({**crane_spec().to_dict(), "state_size": 10**12})


@pytest.mark.parametrize(
    ("metadata", "says"),
    [
        (edit("aerial_il.episode", schema_version="99"), "unknown schema version. expected 2, got 99"),
        (edit("aerial_il.episode", spec=None), "lacks .'spec'."),
        (edit("aerial_il.episode", spec="{"), "malformed metadata"),
        (edit("aerial_il.episode", spec="[" * 100_000), "malformed metadata"),
        (edit("aerial_il.episode", spec=SPEC), "malformed metadata"),
        (edit("aerial_il.episode", ctrl_size="-1"), "malformed metadata"),
        (edit("aerial_il.episode", ctrl_size="3"), "its columns are not those of its specification"),
        (edit("aerial_il.episode", columns="{}"), "its columns are not those of its specification"),
        (edit("aerial_il.episode", uid="somebody-else"), "changed after it was recorded"),
        (edit("aerial_il.provenance", seed="1"), "changed after it was recorded"),
        (edit("aerial_il.provenance", seed=None), "changed after it was recorded"),
        (edit("aerial_il.outcome", success="false"), "changed after it was recorded"),
        (edit("aerial_il.outcome", success="perhaps"), "malformed metadata"),
        (edit("aerial_il.outcome", steps="4"), "topic /step"),
        (edit("aerial_il.outcome", digest=None), "no complete metadata"),
        (lambda entries: {k: v for k, v in entries.items() if k != "aerial_il.outcome"}, "no complete metadata"),
        (lambda entries: {k: v for k, v in entries.items() if k != "aerial_il.provenance"}, "foreign MCAP file"),
    ],
)
def test_metadata_are_checked(demo: Path, tmp_path: Path, metadata: Callable, says: str) -> None:
    with pytest.raises(DemoError, match=says):
        read_episode(rewrite(demo, tmp_path / "changed.mcap", metadata=metadata))


def test_missing_model_and_other_definitions(demo: Path, tmp_path: Path) -> None:
    with pytest.raises(DemoError, match=r"model.xml"):
        read_episode(rewrite(demo, tmp_path / "a.mcap", attachments=False))

    def widen(schema):
        schema.data = schema.data.replace(b"float64", b"float32")
        return schema

    with pytest.raises(DemoError, match="topic of another type"):
        read_episode(rewrite(demo, tmp_path / "b.mcap", schema=widen))


def test_foreign_files_are_refused(tmp_path: Path) -> None:
    foreign = tmp_path / "foreign.mcap"
    with open(foreign, "wb") as file:
        writer = Writer(file, enable_data_crcs=True)
        writer.start("ros2", "somebody")
        channel = writer.register_channel("/chatter", "json", writer.register_schema("any", "jsonschema", b"{}"))
        writer.add_message(channel, 0, b"{}", 0)
        writer.finish()
    with pytest.raises(DemoError, match="foreign MCAP file"):
        read_episode(foreign)
    for name, content in {"text.mcap": b"hello", "empty.mcap": b"", "magic.mcap": MAGIC}.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(DemoError, match=name):
            read_episode(tmp_path / name)
    with pytest.raises(DemoError, match="cannot be read"):
        read_episode(tmp_path)
    with pytest.raises(DemoError, match=r"does not exist.*aerial-il collect"):
        open_dataset(tmp_path / "nowhere")


@pytest.mark.parametrize("declared", [800 << 20, 1 << 20])
def test_decompression_bombs_are_not_inflated(tmp_path: Path, declared: int) -> None:
    """800 MB of zeros in some kilobytes, declared honestly or as less."""
    bomb = zstandard.ZstdCompressor().compressobj(size=800 << 20)
    packed = b"".join(bomb.compress(bytes(1 << 20)) for _ in range(800)) + bomb.flush()
    assert len(packed) < 200_000
    chunk = (
        struct.pack("<QQQI", 0, 0, declared, 0)
        + struct.pack("<I", 4)
        + b"zstd"
        + struct.pack("<Q", len(packed))
        + packed
    )
    from mcap.records import Header

    raw = MAGIC + record_bytes(Header("ros2", "bomb")) + struct.pack("<BQ", 6, len(chunk)) + chunk
    raw += struct.pack("<BQI", 0x0F, 4, zlib.crc32(raw))
    (tmp_path / "bomb.mcap").write_bytes(raw)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(DemoError, match="declares"):
        read_episode(tmp_path / "bomb.mcap")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000


def test_a_message_of_steps_that_swells_is_refused() -> None:
    """A few bytes may not claim a million equal steps, nor columns that are not there."""
    numbers = np.zeros((2, LAYOUT.width))
    numbers[1, 3] = 1.0
    record = columns.to_record(1, columns.Steps(0, 0, numbers), LAYOUT.width)
    assert record is not None
    raw = np.frombuffer(record, np.uint8)
    np.testing.assert_array_equal(columns.from_record(raw, LAYOUT.width).numbers, numbers)
    many, count = raw.copy(), HEAD.size + 4 + 20
    many[count : count + 4] = np.frombuffer(struct.pack("<I", 1_000_000), np.uint8)
    elsewhere, which = raw.copy(), HEAD.size + 4 + 36 + 8 * LAYOUT.width
    elsewhere[which : which + 4] = np.frombuffer(struct.pack("<I", LAYOUT.width), np.uint8)
    for forged, says in ((many, "1000000 steps"), (elsewhere, "does not have"), (raw[:-1], "another size")):
        with pytest.raises(ValueError, match=says):
            columns.from_record(forged, LAYOUT.width)
