"""Read one episode, trusting nothing: every malformed input is a `DemoError` that names file, topic and step."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from aerial_il.core.errors import AerialError, DemoError
from aerial_il.core.specs import EnvSpec
from aerial_il.data.episode import Episode
from aerial_il.data.recording import images
from aerial_il.data.recording.digest import ContentDigest
from aerial_il.data.recording.packing import first_difference
from aerial_il.data.recording.scan import Contents, Stream, scan
from aerial_il.data.recording.schema import RECORD_HEAD, RECORD_HEAD_SIZE, VERSION, Camera, Layout, Topic, nanoseconds
from aerial_il.data.recording.writer import EPISODE, MODEL, OUTCOME, PROVENANCE, definitions
from aerial_il.data.validation import Report, check_episode

_EXTRA_NAME = re.compile(r"[a-z][a-z0-9_]{0,40}")
MAX_ELEMENTS = 1_000_000  # of one message; keeps a forged specification from allocating


@dataclass(frozen=True)
class Head:
    """The records of a file before its first message."""

    uid: str
    layout: Layout
    provenance: Mapping[str, Any]
    model_xml: str


@dataclass(frozen=True)
class Outcome:
    """The records of a file after its last message."""

    success: bool
    steps: int
    note: str


def read_episode(path: Path | str, *, cameras: bool | Sequence[str] = False) -> Episode:
    """Read and check the demonstration file at ``path``.

    Args:
        path: an MCAP file written by this package.
        cameras: True to decode all image fields, or the names of some.

    Raises:
        DemoError: the file is not what it should be.
    """
    path = Path(path)
    contents = scan(path)
    head = read_head(path, contents)
    outcome = read_outcome(path, contents)
    check_channels(path, contents, head.layout)
    report = Report(path)
    messages = read_messages(report, contents, head.layout, outcome.steps)
    episode = build_episode(head, messages, outcome)
    check_episode(report, episode)
    check_views(report, head.layout, messages)
    _check_digest(path, contents, head.layout, messages)
    wanted = [c for c in head.layout.cameras if cameras is True or (cameras and c.field in cameras)]
    pictures = {c.field: _decode(report, c, messages.images[c.field]) for c in wanted}
    return replace(episode, obs={**episode.obs, **pictures})


def read_head(path: Path, contents: Contents) -> Head:
    """Read the metadata that precede the messages."""
    hint = "It was not recorded by aerial_il, or by another version."
    for name in (EPISODE, PROVENANCE):
        if name not in contents.metadata:
            raise DemoError(
                path, f"has no metadata {name!r}: a foreign MCAP file.", got=sorted(contents.metadata), hint=hint
            )
    entries = contents.metadata[EPISODE]
    if missing := {"schema_version", "uid", "ctrl_size", "spec"} - entries.keys():
        raise DemoError(path, f"lacks {sorted(missing)} in its metadata {EPISODE!r}.")
    if entries["schema_version"] != str(VERSION):
        raise DemoError(
            path, "has an unknown schema version.", expected=VERSION, got=entries["schema_version"], hint=hint
        )
    if MODEL not in contents.attachments:
        raise DemoError(path, f"lacks the attachment {MODEL!r}.")
    try:
        layout = _layout(entries["spec"], int(entries["ctrl_size"]), entries.get("extras", "{}"))
        provenance = {key: json.loads(value) for key, value in contents.metadata[PROVENANCE].items()}
        model_xml = contents.attachments[MODEL].decode()
        return Head(entries["uid"], layout, provenance, model_xml)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError, AerialError) as error:
        raise DemoError(path, f"has malformed metadata ({error}).") from error


@lru_cache(maxsize=8)
def _layout(spec_json: str, ctrl_size: int, extras_json: str) -> Layout:
    """Return the layout of a specification, which all files of a dataset have in common."""
    spec, extras = EnvSpec.from_dict(json.loads(spec_json)), _extras(extras_json)
    sizes = [*(f.size for f in spec.observation.fields), spec.state_size, ctrl_size, spec.action.size]
    sizes += map(len, extras.values())
    if not all(0 <= size <= MAX_ELEMENTS for size in sizes):
        raise ValueError(f"sizes {sizes} are not within 0..{MAX_ELEMENTS}")
    plain = Layout(spec, ctrl_size)
    taken = {*(plain.row.names or ()), *(topic.name[1:] for topic in plain.topics)}
    if doubled := extras.keys() & taken:
        raise ValueError(f"extras {min(doubled)!r} have the name of something else")
    return Layout(spec, ctrl_size, extras)


def _extras(text: str) -> dict[str, tuple[str, ...]]:
    """Read the names and labels of further numbers."""
    extras = {name: tuple(labels) for name, labels in json.loads(text).items()}
    for name, labels in extras.items():
        if not _EXTRA_NAME.fullmatch(name) or not labels:
            raise ValueError(f"extras {name!r} have no valid name or no labels")
        if not all(isinstance(label, str) for label in labels):
            raise ValueError(f"labels of {name!r} are not texts")
    return extras


def check_channels(path: Path, contents: Contents, layout: Layout) -> None:
    """Require exactly the layout's channels, types and definitions."""
    expected = definitions(layout)
    types = {schema.id: (schema.name, schema.encoding, schema.data) for schema in expected.schemas}
    found = {c.topic: c for c in contents.channels.values()}
    for channel in expected.channels:
        other = found.get(channel.topic)
        if other is None:
            raise DemoError(path, "lacks a topic.", topic=channel.topic, got=sorted(found))
        schema = contents.schemas.get(other.schema_id)
        mine = types[channel.schema_id]
        if schema is None or (schema.name, schema.encoding, schema.data) != mine or other.message_encoding != "cdr":
            theirs = None if schema is None else (schema.name, schema.encoding)
            raise DemoError(path, "has a topic of another type.", topic=channel.topic, expected=mine[:2], got=theirs)
        if other.id != channel.id:
            raise DemoError(path, "has another channel id.", topic=channel.topic, expected=channel.id, got=other.id)
    if extra := found.keys() - {c.topic for c in expected.channels} or contents.messages.keys() - {
        c.id for c in expected.channels
    }:
        raise DemoError(path, f"has topics or messages that no specification asks for: {sorted(map(str, extra))}.")


Arrays = dict[str, np.ndarray]


@dataclass(frozen=True)
class Messages:
    """The messages of T steps, decoded.

    Attributes:
        records: topic -> message records.
        block: fields of ``Step`` and the flat ``observation`` -> (T, ...).
        last: fields of the terminal record and its ``observation`` -> (1, ...).
        images: camera field -> T + 1 compressed images.
    """

    records: Mapping[str, np.ndarray]
    block: Arrays
    last: Arrays
    images: dict[str, list[bytes]]


def read_messages(report: Report, contents: Contents, layout: Layout, steps: int) -> Messages:
    """Decode a whole episode of ``steps`` steps."""
    records = {topic.name: _records(report, topic, contents, steps + 1) for topic in layout.observed}
    records |= {topic.name: _records(report, topic, contents, steps) for topic in layout.acted}
    records["/terminal"] = _records(report, layout.terminal, contents, 1, first=steps)
    times = records["/observation"]["log_time"]
    report.check_equal("/terminal", "log_time", records["/terminal"]["log_time"], times[-1:])
    observation = records["/observation"]["body"]["position"]
    block = {"observation": observation[:-1], **_fields(records["/step"]["body"]), **_told(layout, records)}
    last = {"observation": observation[-1:], **_fields(records["/terminal"]["body"])}
    report.check_equal("/terminal", "sim_time", nanoseconds(last["sim_time"]), times[-1:])
    return Messages(records, block, last, {c.field: _images(report, c, contents, times) for c in layout.cameras})


def read_whole_steps(report: Report, contents: Contents, layout: Layout, steps: int) -> Messages:
    """Decode the first ``steps`` whole steps of an episode that may lack its end; the last of them becomes its end."""
    records = {topic.name: _records(report, topic, contents, steps) for topic in (*layout.observed, *layout.acted)}
    times = records["/observation"]["log_time"]
    fields = {"observation": records["/observation"]["body"]["position"], **_fields(records["/step"]["body"])}
    fields |= _told(layout, records)
    block, last = ({name: values[rows] for name, values in fields.items()} for rows in (slice(-1), slice(-1, None)))
    return Messages(records, block, last, {c.field: _images(report, c, contents, times) for c in layout.cameras})


def _array_of(block: Arrays, name: str) -> np.ndarray:
    """Return a field (k, ...) that has no bytes, and so no place in a message, where its size is zero."""
    return block.get(name, np.zeros((len(block["sim_time"]), 0)))


def build_episode(head: Head, messages: Messages, outcome: Outcome) -> Episode:
    """Assemble decoded messages."""
    block, last = messages.block, messages.last
    flat = np.concatenate([block["observation"], last["observation"]])
    return Episode(
        uid=head.uid,
        spec=head.layout.spec,
        provenance={**head.provenance, **({"note": outcome.note} if outcome.note else {})},
        obs={name: head.layout.field_of(flat, name) for name in head.layout.spec.observation.state_names},
        actions=block["action"],
        executed_actions=block["executed_action"],
        expert_actions=block["expert_action"],
        is_intervention=block["is_intervention"].astype(bool),
        phase=block["phase"],
        rewards=block["reward"],
        terminated=block["terminated"].astype(bool),
        truncated=block["truncated"].astype(bool),
        states=np.concatenate([_array_of(block, "state"), _array_of(last, "state")]),
        ctrl=_array_of(block, "ctrl"),
        sim_time=np.concatenate([block["sim_time"], last["sim_time"]]),
        success=outcome.success,
        model_xml=head.model_xml,
        extras={name: block[name] for name in head.layout.extras},
        extra_labels=head.layout.extras,
    )


def read_outcome(path: Path, contents: Contents) -> Outcome:
    """Read the metadata that follow the messages."""
    raw = contents.metadata.get(OUTCOME, {})
    if raw.keys() != {"success", "steps", "note", "digest"}:
        raise DemoError(path, f"has no complete metadata {OUTCOME!r}.", got=sorted(raw))
    if raw["success"] not in ("true", "false") or not (raw["steps"].isdecimal() and len(raw["steps"]) < 10):
        raise DemoError(path, f"has malformed metadata {OUTCOME!r}.", got=raw)
    return Outcome(raw["success"] == "true", int(raw["steps"]), raw["note"])


def _records(report: Report, topic: Topic, contents: Contents, count: int, *, first: int = 0) -> np.ndarray:
    """Return the message records of one topic (count,), equal to its template outside the slots."""
    messages = contents.messages.get(topic.channel, Stream())
    if len(messages) != count:
        report.fail("has another number of messages than steps.", topic.name, expected=count, got=len(messages))
    size = len(topic.record_template)
    try:
        raw = messages.joined(size)
    except ValueError:
        step, got = next((i, len(message)) for i, message in enumerate(messages) if len(message) != size)
        report.fail("has a message of another size.", topic.name, step=step, expected=size, got=got)
    if wrong := first_difference(raw, np.frombuffer(topic.record_template, np.uint8), topic.constant_mask):
        step, byte = wrong
        report.fail("differs from its specification.", topic.name, step=step, field=f"byte {byte - RECORD_HEAD_SIZE}")
    records = raw.view(topic.dtype)[:, 0]
    _check_stamps(report, topic, records, np.arange(first, first + count))
    return records


def _check_stamps(report: Report, topic: Topic, records: np.ndarray, steps: np.ndarray) -> None:
    """Require that sequence numbers and the different time stamps of a topic agree."""
    report.check_equal(topic.name, "sequence", records["sequence"], steps)
    report.check_equal(topic.name, "publish_time", records["publish_time"], records["log_time"])
    for slots, part in zip(topic.stamps, np.divmod(records["log_time"], np.uint64(10**9)), strict=True):
        for slot in slots:
            report.check_equal(topic.name, slot, records["body"][slot], part)


def _told(layout: Layout, records: Mapping[str, np.ndarray]) -> Arrays:
    """Return the further numbers that were recorded of each step, by their names."""
    return {name: np.ascontiguousarray(records[f"/{name}"]["body"]["position"]) for name in layout.extras}


def _fields(body: np.ndarray) -> Arrays:
    return {name: np.ascontiguousarray(body[name]) for name in body.dtype.names or ()}


def check_views(report: Report, layout: Layout, messages: Messages) -> None:
    """Require that what people look at shows what is recorded exactly, at the same times."""
    records = messages.records
    times, observed = records["/observation"]["log_time"], records["/observation"]["body"]["position"]
    blocks = (
        (layout.observed, {"observation": observed, **layout.quats(observed)}),
        (layout.acted, records["/step"]["body"]),
    )
    for topic, block in ((topic, block) for topics, block in blocks for topic in topics):
        body = records[topic.name]["body"]
        report.check_equal(topic.name, "log_time", records[topic.name]["log_time"], times[: len(body)])
        for slot in topic.sources:
            if slot == "orientation" or slot.startswith("rotation"):
                report.check_unit(topic.name, slot, body[slot])
            elif topic.name not in ("/observation", "/step") and topic not in layout.told:  # they stand for themselves
                report.check_equal(topic.name, slot, body[slot], topic.expected(slot, block))
    sim_time = records["/step"]["body"]["sim_time"]
    report.check_equal("/step", "sim_time", nanoseconds(sim_time), times[: len(sim_time)])


def _images(report: Report, camera: Camera, contents: Contents, times: np.ndarray) -> list[bytes]:
    """Return the compressed images of one camera, one for each of ``times``."""
    messages = contents.messages.get(camera.channel, Stream())
    if len(messages) != len(times):
        report.fail(
            "has another number of images than observations.", camera.name, expected=len(times), got=len(messages)
        )
    dtype = np.dtype([*RECORD_HEAD, ("body", camera.template.dtype)])
    found = []
    for i, (message, time) in enumerate(zip(messages, times.tolist(), strict=True)):
        if len(message) < dtype.itemsize:
            report.fail("has a message that is too short.", camera.name, step=i)
        record = np.frombuffer(message[: dtype.itemsize], dtype)[0]
        if (int(record["sequence"]), int(record["log_time"])) != (i, time):
            got = (int(record["sequence"]), int(record["log_time"]))
            report.fail("is out of order.", camera.name, step=i, expected=(i, time), got=got)
        if int(record["body"]["size"]) != len(message) - dtype.itemsize:
            report.fail("has a message of another size.", camera.name, step=i)
        found.append(message[dtype.itemsize :].tobytes())
    return found


def _decode(report: Report, camera: Camera, compressed: list[bytes]) -> np.ndarray:
    """Decode the images of one camera to (T + 1, *shape)."""
    decoded = []
    for i, data in enumerate(compressed):
        try:
            decoded.append(images.decode(camera.field, data, camera.shape))
        except ValueError as error:
            report.fail(str(error), camera.name, step=i)
    return np.stack(decoded)


def _check_digest(path: Path, contents: Contents, layout: Layout, messages: Messages) -> None:
    digest = ContentDigest()
    for topic in layout.topics:
        digest.update(topic.name, messages.records[topic.name])
    for camera in layout.cameras:
        for message in contents.messages[camera.channel]:
            digest.update(camera.name, message)
    outcome = dict(contents.metadata[OUTCOME])
    expected = outcome.pop("digest")
    got = digest.hexdigest({**contents.metadata, OUTCOME: outcome}, contents.attachments)
    if got != expected:
        raise DemoError(
            path, "was changed after it was recorded: its content digest differs.", expected=expected, got=got
        )
