"""Read one episode, trusting nothing: every malformed input is a `DemoError` that names file, topic and step."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from aerial_il.core.bounded import parse_json
from aerial_il.core.computer import MEMORY_MB, free_memory_bytes
from aerial_il.core.errors import AerialError, DemoError
from aerial_il.core.specs import EnvSpec
from aerial_il.data.check import Gate, require_whole
from aerial_il.data.episode import Episode
from aerial_il.data.recording.container import Definitions
from aerial_il.data.recording.decoding import Messages
from aerial_il.data.recording.encoding import images
from aerial_il.data.recording.encoding.digest import ContentDigest
from aerial_il.data.recording.encoding.topics import Camera
from aerial_il.data.recording.form import Form, form_of
from aerial_il.data.recording.report import Report
from aerial_il.data.recording.scan import Contents, scan
from aerial_il.data.recording.schema import VERSION, Layout
from aerial_il.data.recording.writer import EPISODE, MODEL, OUTCOME, PROVENANCE

_EXTRA_NAME = re.compile(r"[a-z][a-z0-9_]{0,40}")
MAX_ELEMENTS = 100_000  # numbers of one step, all fields together; keeps a forged specification from allocating
MAX_PIXELS = 16_000_000  # of all cameras together
MAX_DECODED = MEMORY_MB << 20  # bytes of one camera in one episode


@dataclass(frozen=True)
class Head:
    """The records of a file before its first message."""

    uid: str
    layout: Layout
    form: Form
    provenance: Mapping[str, Any]
    model_xml: str


@dataclass(frozen=True)
class Outcome:
    """The records of a file after its last message."""

    success: bool
    steps: int
    note: str
    made_of: Mapping[str, Any]

    @property
    def provenance(self) -> dict[str, Any]:
        """What it adds to the provenance."""
        told = {"note": self.note, "made_of": self.made_of}
        return {key: value for key, value in told.items() if value}


def read_episode(path: Path | str, *, cameras: bool | Sequence[str] = False) -> Episode:
    """Read and check the demonstration file at ``path``, as :func:`~aerial_il.data.dataset.open_dataset` does.

    Args:
        path: an MCAP file written by this package.
        cameras: True to decode all image fields, or the names of some.

    Raises:
        DemoError: the file is not what it should be.
    """
    episode = decode_episode(Path(path), cameras=cameras)
    require_whole(Gate(path), episode)
    return episode


def decode_episode(path: Path, *, cameras: bool | Sequence[str] = False, states: bool = True) -> Episode:
    """Read the demonstration file at ``path``; require all but what the gate requires of every format.

    Args:
        path: an MCAP file written by this package.
        cameras: True to decode all image fields, or the names of some. states: False to leave them out.
    """
    contents = scan(path)
    head, outcome = read_head(path, contents), read_outcome(path, contents)
    check_channels(path, contents, head.form.definitions)
    report = Report(path)
    messages = head.form.read(report, contents, outcome.steps)
    wanted = [c for c in head.form.cameras if cameras is True or (cameras and c.field in cameras)]
    episode = _episode(head, messages, outcome, states=states)
    if wrong := _wrong_digest(path, contents, messages):
        require_whole(Gate(path), _episode(head, messages, outcome, states=True))  # which says where, if it can
        raise wrong
    pictures = {camera.field: _decode(report, camera, messages.images[camera.field]) for camera in wanted}
    return replace(episode, obs={**episode.obs, **pictures})


def read_origin(path: Path) -> Mapping[str, Any]:
    """Return the provenance of the episode at ``path``, of which nothing else is decoded."""
    contents = scan(path)
    return {**read_head(path, contents).provenance, **read_outcome(path, contents).provenance}


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
    version = entries["schema_version"]
    if version != str(VERSION):
        raise DemoError(path, "has an unknown schema version.", expected=VERSION, got=version, hint=hint)
    if MODEL not in contents.attachments:
        raise DemoError(path, f"lacks the attachment {MODEL!r}.")
    try:
        layout = _layout(entries["spec"], int(entries["ctrl_size"]), entries.get("extras", "{}"))
        if entries.get("columns") != layout.columns_json:
            raise ValueError("its columns are not those of its specification")
        provenance = {key: parse_json(value) for key, value in contents.metadata[PROVENANCE].items()}
        model_xml = _text(contents.attachments[MODEL])
        return Head(entries["uid"], layout, form_of(layout), provenance, model_xml)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError, AerialError) as error:
        raise DemoError(path, f"has malformed metadata ({error}).") from error


@lru_cache(maxsize=8)
def _layout(spec_json: str, ctrl_size: int, extras_json: str) -> Layout:
    """Return the layout of a specification, which all files of a dataset have in common."""
    spec, extras = EnvSpec.from_dict(parse_json(spec_json)), _extras(extras_json)
    _check_sizes(spec, [spec.state_size, ctrl_size, 4 * spec.action.size, *map(len, extras.values())])
    plain = Layout(spec, ctrl_size)
    topics = {channel.topic[1:] for channel in Form(plain).definitions.channels}
    taken = {*(plain.row.names or ()), *topics, "step", "sec", "nanosec", "time_ns", "padding"}
    if doubled := extras.keys() & taken:
        raise ValueError(f"extras {min(doubled)!r} have the name of something else")
    return Layout(spec, ctrl_size, extras)


def _check_sizes(spec: EnvSpec, sizes: Sequence[int]) -> None:
    """Require that a step, with its observation and what else has these ``sizes``, is one that can be held."""
    groups = {"image": MAX_PIXELS, "proprio": MAX_ELEMENTS, "task": MAX_ELEMENTS}
    for field in spec.observation.fields:
        if not all(type(side) is int and 0 <= side <= MAX_PIXELS for side in field.shape) or field.group not in groups:
            raise ValueError(f"field {field.name!r} has a shape {field.shape} or group {field.group!r} that cannot be")
    pictures = sum(math.prod(f.shape) for f in spec.observation.of_group("image"))
    numbers = sum(math.prod(f.shape) for f in spec.observation.fields) - pictures + sum(sizes)
    if min(sizes) < 0 or numbers > MAX_ELEMENTS or pictures > MAX_PIXELS:
        raise ValueError(
            f"a step has {numbers} numbers, {pictures} pixels; the most are {MAX_ELEMENTS} and {MAX_PIXELS}"
        )


def _extras(text: str) -> dict[str, tuple[str, ...]]:
    """Read the names and labels of further numbers."""
    extras = {name: tuple(labels) for name, labels in parse_json(text).items()}
    for name, labels in extras.items():
        if not _EXTRA_NAME.fullmatch(name) or not labels:
            raise ValueError(f"extras {name!r} have no valid name or no labels")
        if not all(isinstance(label, str) for label in labels):
            raise ValueError(f"labels of {name!r} are not texts")
    return extras


def check_channels(path: Path, contents: Contents, expected: Definitions) -> None:
    """Require exactly these channels, types and definitions."""
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
        raise DemoError(
            path, f"has topics or messages that its specification does not list: {sorted(map(str, extra))}."
        )


@lru_cache(maxsize=8)
def _text(model: bytes) -> str:
    """Return a scene as text, the same one for all episodes that were flown in it."""
    return model.decode()


def _episode(head: Head, messages: Messages, outcome: Outcome, *, states: bool) -> Episode:
    """Copy what an episode holds out of the rows, which are freed then: most of them are states."""
    rows, steps, layout = messages.rows, messages.rows[:-1], head.layout
    flat = _array(rows["observation"])
    return Episode(
        uid=head.uid,
        spec=layout.spec,
        provenance={**head.provenance, **outcome.provenance},
        obs={name: layout.field_of(flat, name) for name in layout.spec.observation.state_names},
        actions=_array(steps["action"]),
        executed_actions=_array(steps["executed_action"]),
        expert_actions=_array(steps["expert_action"]),
        is_intervention=steps["is_intervention"].astype(bool),
        phase=steps["phase"].astype(np.int32),
        rewards=_array(steps["reward"]),
        terminated=steps["terminated"].astype(bool),
        truncated=steps["truncated"].astype(bool),
        states=_array(rows["state"]) if states else np.zeros((len(rows), 0)),
        ctrl=_array(steps["ctrl"]),
        sim_time=_array(rows["sim_time"]),
        success=outcome.success,
        model_xml=head.model_xml,
        extras={name: _array(steps[name]) for name in layout.extras},
        extra_labels=layout.extras,
    )


def _array(values: np.ndarray) -> np.ndarray:
    """Return a field of rows as an array of its own."""
    return np.array(values, order="C")


def read_outcome(path: Path, contents: Contents) -> Outcome:
    """Read the metadata that follow the messages."""
    raw = contents.metadata.get(OUTCOME, {})
    if raw.keys() - {"made_of"} != {"success", "steps", "note", "digest"}:
        raise DemoError(path, f"has no complete metadata {OUTCOME!r}.", got=sorted(raw))
    if raw["success"] not in ("true", "false") or not (raw["steps"].isdecimal() and len(raw["steps"]) < 10):
        raise DemoError(path, f"has malformed metadata {OUTCOME!r}.", got=raw)
    return Outcome(raw["success"] == "true", int(raw["steps"]), raw["note"], _made_of(path, raw.get("made_of", "{}")))


def _made_of(path: Path, text: str) -> dict[str, Any]:
    try:
        told = parse_json(text)
    except ValueError:
        told = None
    if not isinstance(told, dict):
        raise DemoError(path, f"has malformed metadata {OUTCOME!r}.", got=text[:200])
    return told


def _decode(report: Report, camera: Camera, compressed: list[bytes]) -> np.ndarray:
    """Decode the images of one camera to (T + 1, *shape)."""
    size = len(compressed) * math.prod(camera.shape) * np.dtype(camera.dtype).itemsize
    if size > max(MAX_DECODED, free_memory_bytes() // 2):
        limit = f"at most {MAX_DECODED >> 20} MB, or half of the memory that is free"
        report.fail(
            "has more pixels than can be held: record smaller images or fewer, image_size=[H,W] or NAME@HxW@10Hz.",
            camera.name, expected=limit, got=f"{size >> 20} MB",
        )  # fmt: skip
    decoded = []
    for i, data in enumerate(compressed):
        try:
            decoded.append(images.decode(data, camera.dtype, camera.shape))
        except ValueError as error:
            report.fail(str(error), camera.name, step=i)
    return np.stack(decoded)


def _wrong_digest(path: Path, contents: Contents, messages: Messages) -> DemoError | None:
    """Return the error that a file is not as it was recorded, or None."""
    digest = ContentDigest()
    for topic, records in messages.digested.items():
        for record in records:
            digest.update(topic, record)
    outcome = dict(contents.metadata[OUTCOME])
    expected = outcome.pop("digest")
    got = digest.hexdigest({**contents.metadata, OUTCOME: outcome}, contents.attachments)
    if got == expected:
        return None
    problem = "was changed after it was recorded: its content digest differs."
    return DemoError(path, problem, expected=expected, got=got)
