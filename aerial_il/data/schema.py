"""What a demonstration file holds: its topics, and the exact bytes of each of them for a given environment.

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
=====================  ==========================  ==========================================================

The topics above ``/step`` have T + 1 messages, as have the cameras; ``log_time`` is simulation time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aerial_il.core.specs import EnvSpec
from aerial_il.data import messages
from aerial_il.data.cdr import CdrTemplate
from aerial_il.data.poses import quat_xyzw

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

Block = Mapping[str, np.ndarray]
Fill = Callable[[np.ndarray, Block], None]


@dataclass(frozen=True)
class Topic:
    """One topic of fixed-size messages.

    Attributes:
        channel: MCAP channel id.
        name: topic name.
        type: ROS 2 message type.
        template: the message's bytes and slots.
        fill: writes a block of k steps into the slots of k messages.
    """

    channel: int
    name: str
    type: str
    template: CdrTemplate
    fill: Fill

    @cached_property
    def dtype(self) -> np.dtype:
        """Structured dtype of one MCAP message record: its head, then the ``body``."""
        return np.dtype([*RECORD_HEAD, ("body", self.template.dtype)])

    @cached_property
    def stamps(self) -> tuple[list[str], list[str]]:
        """Slots that hold seconds and nanoseconds."""
        names = self.template.dtype.names or ()
        return [n for n in names if n.startswith("sec")], [n for n in names if n.startswith("nanosec")]

    def encode(self, records: np.ndarray, block: Block, steps: np.ndarray, time_ns: np.ndarray) -> None:
        """Write k messages into ``records`` (k,) of :attr:`dtype`, which hold the template already."""
        records["sequence"] = steps
        records["log_time"] = records["publish_time"] = time_ns
        body = records["body"]
        for slots, part in zip(self.stamps, np.divmod(time_ns, np.uint64(10**9)), strict=True):
            for slot in slots:
                body[slot] = part
        self.fill(body, block)

    @cached_property
    def record_template(self) -> bytes:
        body = self.template.content
        head = np.zeros(1, RECORD_HEAD)
        head["opcode"], head["length"], head["channel"] = MESSAGE_OPCODE, MESSAGE_HEAD_SIZE + len(body), self.channel
        return head.tobytes() + body


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
    """

    def __init__(self, spec: EnvSpec, ctrl_size: int) -> None:
        self.spec, self.ctrl_size = spec, ctrl_size
        self._channels = 0
        names = spec.observation.state_names
        labels = tuple(label for name in names for label in spec.observation[name].element_labels())
        self.observed = [self._topic("/observation", messages.JOINT_STATE, messages.joint_state(labels), _observation)]
        self.observed += self._joint_topics() + self._pose_topics()
        sizes = {"state_size": spec.state_size, "ctrl_size": ctrl_size, "action_size": spec.action.size}
        self.step = self._topic("/step", messages.STEP, messages.step(**sizes), _copy_all)
        self.acted = [
            self.step,
            self._topic("/action", messages.JOINT_STATE, messages.joint_state(spec.action.labels), _action),
            self._topic("/reward", messages.FLOAT_ARRAY, messages.float_array(1), _reward),
        ]
        last = messages.step(state_size=spec.state_size, ctrl_size=0, action_size=0)
        self.terminal = self._topic("/terminal", messages.STEP, last, _copy_all)
        self.cameras = [Camera(self._next_channel(), f.name, f.shape) for f in spec.observation.of_group("image")]

    @property
    def topics(self) -> list[Topic]:
        return [*self.observed, *self.acted, self.terminal]

    @cached_property
    def observation_slices(self) -> dict[str, slice]:
        """Where each state field lies in the flat observation."""
        ends = np.cumsum([self.spec.observation[name].size for name in self.spec.observation.state_names])
        return {
            name: slice(end - self.spec.observation[name].size, end)
            for name, end in zip(self.spec.observation.state_names, ends.tolist(), strict=True)
        }

    @cached_property
    def step_bytes(self) -> int:
        """Size of one whole step, before compression and without images."""
        return sum(len(topic.record_template) for topic in (*self.observed, *self.acted))

    def field_of(self, flat: np.ndarray, name: str) -> np.ndarray:
        """Cut field ``name`` (k, *shape) in its own dtype out of flat observations (k, Do)."""
        field = self.spec.observation[name]
        return flat[:, self.observation_slices[name]].reshape(-1, *field.shape).astype(field.dtype, copy=False)

    def steps(self, block: Block, first: int) -> np.ndarray:
        """Encode k whole steps, beginning with step ``first``, as a structured array (k,) with one field a topic."""
        return _encode([*self.observed, *self.acted], self.with_quats(block), first)

    def last(self, block: Block, step: int) -> np.ndarray:
        """Encode the terminal record (a block of one step) as a structured array (1,)."""
        return _encode([*self.observed, self.terminal], self.with_quats(block), step)

    def _next_channel(self) -> int:
        self._channels += 1
        return self._channels

    def _topic(self, name: str, message_type: str, template: CdrTemplate, fill: Fill) -> Topic:
        return Topic(self._next_channel(), name, message_type, template, fill)

    def _joint_topics(self) -> list[Topic]:
        names = self.spec.observation.names
        if "joint_pos" not in names:
            return []
        labels, where = self.spec.observation["joint_pos"].element_labels(), self.observation_slices
        velocity = where.get("joint_vel")

        def fill(body: np.ndarray, block: Block) -> None:
            body["position"] = block["observation"][:, where["joint_pos"]]
            if velocity is not None:
                body["velocity"] = block["observation"][:, velocity]

        template = messages.joint_state(labels, velocity=velocity is not None)
        return [self._topic("/joint_states", messages.JOINT_STATE, template, fill)]

    def _pose_topics(self) -> list[Topic]:
        bodies = tuple(f.name.removesuffix("_pos") for f in self.spec.observation.fields if _is_position(f))
        poses = [
            self._topic(f"/pose/{b}", messages.POSE_STAMPED, messages.pose_stamped("world"), self._pose(b))
            for b in bodies
        ]

        self._bodies = bodies

        def fill(body: np.ndarray, block: Block) -> None:
            for i, name in enumerate(bodies):
                body[f"translation{i}"] = block["observation"][:, self.observation_slices[f"{name}_pos"]]
                body[f"rotation{i}"] = block[f"quat_{name}"]

        tree = messages.transforms("world", bodies)
        return [*poses, self._topic("/tf", messages.TF_MESSAGE, tree, fill)] if bodies else []

    def _pose(self, name: str) -> Fill:
        def fill(body: np.ndarray, block: Block) -> None:
            body["position"] = block["observation"][:, self.observation_slices[f"{name}_pos"]]
            body["orientation"] = block[f"quat_{name}"]

        return fill

    def with_quats(self, block: Block) -> Block:
        """Add to a block the unit quaternion ``quat_<body>`` (k, 4), x y z w, of every body that is shown."""
        flat, where = block["observation"], self.observation_slices
        quats = {f"quat_{body}": np.tile([0.0, 0.0, 0.0, 1.0], (len(flat), 1)) for body in self._bodies}
        turning = [body for body in self._bodies if f"{body}_rot6d" in where]
        if turning:
            rot6d = np.concatenate([flat[:, where[f"{body}_rot6d"]] for body in turning])
            parts = np.split(quat_xyzw(rot6d), len(turning))
            quats.update((f"quat_{body}", part) for body, part in zip(turning, parts, strict=True))
        return {**block, **quats}


def nanoseconds(sim_time: np.ndarray) -> np.ndarray:
    """Return simulation time in whole nanoseconds, as MCAP stamps it."""
    return np.round(np.asarray(sim_time) * 1e9).astype(np.uint64)


def _encode(topics: list[Topic], block: Block, first: int) -> np.ndarray:
    time_ns = nanoseconds(block["sim_time"])
    count = len(time_ns)
    row = b"".join(topic.record_template for topic in topics)
    records = np.frombuffer(bytearray(row * count), np.dtype([(topic.name, topic.dtype) for topic in topics]))
    for topic in topics:
        topic.encode(records[topic.name], block, np.arange(first, first + count), time_ns)
    return records


def _is_position(field) -> bool:
    return field.name.endswith("_pos") and field.shape == (3,) and field.unit == "m"


def _observation(body: np.ndarray, block: Block) -> None:
    body["position"] = block["observation"]


def _action(body: np.ndarray, block: Block) -> None:
    body["position"] = block["action"]


def _reward(body: np.ndarray, block: Block) -> None:
    body["data"] = block["reward"][:, None]


def _copy_all(body: np.ndarray, block: Block) -> None:
    for name in body.dtype.names:
        if name in block:
            body[name] = block[name]
