"""The content of a demonstration file: its topics, and the exact bytes of each of them for a given environment.

=====================  ==========================  ==========================================================
topic                  type                        content
=====================  ==========================  ==========================================================
``/observation``       JointState                  every state observation, exact, named element by element
``/joint_states``      JointState                  the arm's joints, where the robot observes any
``/pose/<body>``       PoseStamped                 of each ``<body>_pos`` in metres, with ``<body>_rot6d`` if any
``/tf``                TFMessage                   the same poses as a tree under ``world``
``/step``              aerial_il_msgs/Step         T records: state before, action, outcome; exact
``/action``            JointState                  the commanded action, named
``/reward``            Float64MultiArray           one element
``/terminal``          aerial_il_msgs/Step         the state after the last step
``/camera/<name>``     CompressedImage             JPEG (RGB) or PNG (depth in mm, segmentation id + 1)
``/<extra>``           JointState                  what else a recorder was told to keep, e.g. ``/device``; exact
=====================  ==========================  ==========================================================

The topics above ``/step`` have T + 1 messages, as have the cameras; ``log_time`` is simulation time.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

import numpy as np

from aerial_il.core.specs import EnvSpec, Field
from aerial_il.data.recording import messages
from aerial_il.data.recording.cdr import CdrTemplate
from aerial_il.data.recording.packing import Move, Packer
from aerial_il.data.recording.poses import quat_xyzw

VERSION = 1
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
    """One topic of fixed-size messages.

    Attributes:
        channel: MCAP channel id.
        name: topic name.
        type: ROS 2 message type.
        template: the message's bytes and slots.
        sources: slot -> field of a step, and which of its columns; time stamps fill themselves.
    """

    channel: int
    name: str
    type: str
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
    """One image field and its topic of compressed images."""

    channel: int
    field: str
    shape: tuple[int, ...]

    @property
    def name(self) -> str:
        return f"/camera/{self.field}"

    @property
    def format(self) -> str:
        return "jpeg" if self.field.endswith("_rgb") else "png"

    @cached_property
    def template(self) -> CdrTemplate:
        return messages.compressed_image(self.field, self.format)


class Layout:
    """The topics of demonstrations of one environment, and the bytes of its steps.

    Args:
        spec: the environment's specification.
        ctrl_size: number of actuator controls.
        extras: name -> labels of further numbers of each step, a topic of their own; most recordings have none.
    """

    def __init__(self, spec: EnvSpec, ctrl_size: int, extras: Extras = NO_EXTRAS) -> None:
        self.spec, self.ctrl_size = spec, ctrl_size
        self.extras = {name: tuple(labels) for name, labels in extras.items()}
        self._channels = 0
        names = spec.observation.state_names
        labels = tuple(label for name in names for label in spec.observation[name].element_labels())
        self.observed = [
            self._topic(
                "/observation", messages.JOINT_STATE, messages.joint_state(labels), {"position": ("observation", ALL)}
            )
        ]
        self.observed += self._joint_topics() + self._pose_topics()
        sizes = {"state_size": spec.state_size, "ctrl_size": ctrl_size, "action_size": spec.action.size}
        step, last = messages.step(**sizes), messages.step(**{**sizes, "ctrl_size": 0, "action_size": 0})
        action = messages.joint_state(spec.action.labels)
        self.step = self._topic("/step", messages.STEP, step, _whole(step))
        self.acted = [
            self.step,
            self._topic("/action", messages.JOINT_STATE, action, {"position": ("action", ALL)}),
            self._topic("/reward", messages.FLOAT_ARRAY, messages.float_array(1), {"data": ("reward", ALL)}),
        ]
        self.terminal = self._topic("/terminal", messages.STEP, last, _whole(last, ("step", "sim_time", "state")))
        self.cameras = [Camera(self._next_channel(), f.name, f.shape) for f in spec.observation.of_group("image")]
        self.told = [
            self._topic(f"/{name}", messages.JOINT_STATE, messages.joint_state(labels), {"position": (name, ALL)})
            for name, labels in self.extras.items()
        ]
        self.acted += self.told

    @property
    def topics(self) -> list[Topic]:
        return [*self.observed, *self.acted, self.terminal]

    @cached_property
    def _state_fields(self) -> tuple[Field, ...]:
        return tuple(self.spec.observation[name] for name in self.spec.observation.state_names)

    @cached_property
    def observation_slices(self) -> dict[str, slice]:
        """Where each state field lies in the flat observation."""
        ends = np.cumsum([field.size for field in self._state_fields]).tolist()
        return {f.name: slice(end - f.size, end) for f, end in zip(self._state_fields, ends, strict=True)}

    def finite_until(self, name: str) -> int:
        """Return how many of the row's first numbers must be finite, up to and with the field ``name``."""
        dtype, first = place_of(self.row, name)
        return (first + dtype.itemsize) // 8

    def name_of_number(self, column: int) -> tuple[str, list[int]]:
        """Return the field that a number of the row belongs to, and where in it, for messages to people."""
        assert self.row.fields is not None
        for name, (dtype, first, *_) in self.row.fields.items():
            if first <= 8 * column < first + dtype.itemsize:
                return name, [column - first // 8] if dtype.shape else []
        raise IndexError(column)

    @cached_property
    def step_bytes(self) -> int:
        """Size of one whole step, before compression and without images."""
        return sum(len(topic.record_template) for topic in (*self.observed, *self.acted))

    def field_of(self, flat: np.ndarray, name: str) -> np.ndarray:
        """Cut field ``name`` (k, *shape) in its own dtype out of flat observations (k, Do)."""
        field = self.spec.observation[name]
        return flat[:, self.observation_slices[name]].reshape(-1, *field.shape).astype(field.dtype, copy=False)

    @cached_property
    def spec_json(self) -> str:
        """The specification as it stands in every file."""
        return json.dumps(self.spec.to_dict(), allow_nan=False)

    @cached_property
    def row(self) -> np.dtype:
        """Structured dtype of one step as it is gathered.

        First the numbers that must be finite, and of these first what a terminal step has too; then all others.
        ``time_ns``, ``sec``, ``nanosec``, ``step`` and the quaternions follow from the rest; see :meth:`complete`.
        """
        observed, action = sum(f.size for f in self._state_fields), self.spec.action.size
        sizes = {"observation": observed, "state": self.spec.state_size}
        outcome = {"ctrl": self.ctrl_size, "action": action, "executed_action": action}
        quats = {f"quat_{body}": 4 for body in self._bodies}
        numbers: list[tuple] = [
            ("sim_time", "<f8"),
            *((name, "<f8", (size,)) for name, size in sizes.items()),
            ("reward", "<f8"),
            *((name, "<f8", (size,)) for name, size in {**outcome, "expert_action": action, **quats}.items()),
            *((name, "<f8", (len(labels),)) for name, labels in self.extras.items()),
        ]
        counters = [("time_ns", "<u8"), ("sec", "<i4"), ("nanosec", "<u4"), ("step", "<u4"), ("phase", "<i4")]
        flags = [(name, "u1") for name in ("is_intervention", "terminated", "truncated")]
        return np.dtype([*numbers, *counters, *flags, ("padding", "u1", (5,))])

    def rows(self, block: Block) -> np.ndarray:
        """Return the steps (k,) of a block as rows."""
        rows = np.zeros(len(block["sim_time"]), self.row)
        for name in block.keys() & set(self.row.names or ()):
            rows[name] = block[name]
        return rows

    def complete(self, rows: np.ndarray, first: int) -> None:
        """Fill in what follows from the rest in ``rows`` (k,), which begin with step ``first``."""
        rows["step"] = np.arange(first, first + len(rows))
        rows["time_ns"] = nanoseconds(rows["sim_time"])
        rows["sec"], rows["nanosec"] = np.divmod(rows["time_ns"], np.uint64(10**9))
        for name, quats in self.quats(rows["observation"]).items():
            rows[name] = quats

    @cached_property
    def steps(self) -> Packer:
        """Makes the records of whole steps: of every topic one, in the order of ``observed`` and ``acted``."""
        return self._packer([*self.observed, *self.acted])

    @cached_property
    def ending(self) -> Packer:
        """Makes the records of the terminal step: of every topic of ``observed`` one, then ``terminal``."""
        return self._packer([*self.observed, self.terminal])

    def _packer(self, topics: Sequence[Topic]) -> Packer:
        starts = np.cumsum([0, *(len(topic.record_template) for topic in topics)]).tolist()
        moves = [
            (source, start + target, size)
            for topic, start in zip(topics, starts[:-1], strict=True)
            for source, target, size in topic.moves(self.row)
        ]
        return Packer(b"".join(topic.record_template for topic in topics), moves)

    def _next_channel(self) -> int:
        self._channels += 1
        return self._channels

    def _topic(self, name: str, message_type: str, template: CdrTemplate, sources: Sources) -> Topic:
        return Topic(self._next_channel(), name, message_type, template, sources)

    def _joint_topics(self) -> list[Topic]:
        names = self.spec.observation.names
        if "joint_pos" not in names:
            return []
        labels, where = self.spec.observation["joint_pos"].element_labels(), self.observation_slices
        sources = {"position": ("observation", where["joint_pos"])}
        if moving := "joint_vel" in where:
            sources["velocity"] = ("observation", where["joint_vel"])
        return [
            self._topic("/joint_states", messages.JOINT_STATE, messages.joint_state(labels, velocity=moving), sources)
        ]

    def _pose_topics(self) -> list[Topic]:
        bodies = tuple(f.name.removesuffix("_pos") for f in self.spec.observation.fields if _is_position(f))
        self._bodies = bodies
        places = {body: ("observation", self.observation_slices[f"{body}_pos"]) for body in bodies}
        turns = {body: (f"quat_{body}", ALL) for body in bodies}
        poses = [
            self._topic(
                f"/pose/{body}",
                messages.POSE_STAMPED,
                messages.pose_stamped("world"),
                {"position": places[body], "orientation": turns[body]},
            )
            for body in bodies
        ]
        frames = {f"translation{i}": places[body] for i, body in enumerate(bodies)}
        frames |= {f"rotation{i}": turns[body] for i, body in enumerate(bodies)}
        tree = messages.transforms("world", bodies)
        return [*poses, self._topic("/tf", messages.TF_MESSAGE, tree, frames)] if bodies else []

    def quats(self, flat: np.ndarray) -> dict[str, np.ndarray]:
        """Return the unit quaternion ``quat_<body>`` (k, 4), x y z w, of every body, from flat observations (k, Do)."""
        where = self.observation_slices
        quats = {f"quat_{body}": np.array([[0.0, 0.0, 0.0, 1.0]]).repeat(len(flat), 0) for body in self._bodies}
        turning = [body for body in self._bodies if f"{body}_rot6d" in where]
        if turning:
            rot6d = np.concatenate([flat[:, where[f"{body}_rot6d"]] for body in turning])
            parts = quat_xyzw(rot6d).reshape(len(turning), len(flat), 4)
            quats.update((f"quat_{body}", part) for body, part in zip(turning, parts, strict=True))
        return quats


def nanoseconds(sim_time: np.ndarray) -> np.ndarray:
    """Return simulation time in whole nanoseconds, as MCAP stamps it."""
    return np.round(np.asarray(sim_time) * 1e9).astype(np.uint64)


def _is_position(field) -> bool:
    return field.name.endswith("_pos") and field.shape == (3,) and field.unit == "m"


def _whole(template: CdrTemplate, names: Sequence[str] | None = None) -> Sources:
    """Return sources for the slots of a template that bear the names of fields: all, or those in ``names``."""
    slots = [slot for slot in template.dtype.names or () if slot not in ("sec", "nanosec")]
    return {slot: (slot, ALL) for slot in slots if names is None or slot in names}


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
