"""Files that the tools of ROS 2 read: MCAP with standard messages alone.

They are made for looking at flights, in Foxglove, RViz or rerun, and are derived from recordings, which they do not
replace. Stamps are simulation time.
"""

import io
import os
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.writer import Writer
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from aerial_il.core.files import write_atomic
from aerial_il.data.recording.container import LIBRARY
from aerial_il.data.recording.encoding.images import encode, whole_numbers
from aerial_il.data.recording.encoding.messages import (
    COMPRESSED_IMAGE,
    JOINT_STATE,
    TF_MESSAGE,
)
from aerial_il.data.recording.encoding.topics import nanoseconds
from aerial_il.data.recording.writer import storing

STRING, MARKERS = "std_msgs/msg/String", "visualization_msgs/msg/MarkerArray"
IMAGE, CAMERA_INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
FOREVER = "{sec: 9223372036, nsec: 854775807}"
LASTING = (  # the quality of service by which late subscribers are served, too: durability "transient local"
    "- {history: 1, depth: 1, reliability: 1, durability: 1, liveliness: 1, avoid_ros_namespace_conventions: false, "
    f"deadline: {FOREVER}, lifespan: {FOREVER}, liveliness_lease_duration: {FOREVER}}}\n"
)
Values = dict[str, Any]  # of a message; those that are left out are zero or empty


class Frame(NamedTuple):
    """A frame in another one: its place (3,) in m, and its quaternion (4,) x y z w."""

    parent: str
    name: str
    pos: np.ndarray
    xyzw: np.ndarray

    @property
    def pose(self) -> Values:
        """It as a pose."""
        return {"position": vector(self.pos), "orientation": vector(self.xyzw)}


class Bag:
    """The messages of one flight, in the order of their times; :meth:`save` makes the file."""

    def __init__(self) -> None:
        self._file = io.BytesIO()
        self._writer = Writer(self._file, chunk_size=1 << 18, enable_data_crcs=True)
        self._writer.start(profile="ros2", library=LIBRARY)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}

    def add(self, topic: str, time_s: float, kind: str, values: Values, *, lasting: bool = False) -> None:
        """Add a message of the type ``kind`` at a time; ``lasting``: it holds for ever."""
        if topic not in self._channels:
            service = {"offered_qos_profiles": LASTING} if lasting else {}
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schema(kind), service)
        data, time = bytes(_types().serialize_cdr(message(kind, values), kind)), int(nanoseconds(np.array(time_s)))
        self._writer.add_message(self._channels[topic], log_time=time, publish_time=time, data=data)

    def frames(self, topic: str, time_s: float, frames: Iterable[Frame], *, lasting: bool = False) -> None:
        """Add where frames are; ``lasting``: for ever."""
        stamped = [
            {
                "header": header(time_s, frame.parent),
                "child_frame_id": frame.name,
                "transform": {"translation": vector(frame.pos), "rotation": vector(frame.xyzw)},
            }
            for frame in frames
        ]
        self.add(topic, time_s, TF_MESSAGE, {"transforms": stamped}, lasting=lasting)

    def named(self, topic: str, time_s: float, names: Sequence[str], values: Any, rates: Any = ()) -> None:
        """Add named numbers, and how fast they change, as the state of joints."""
        state = {"header": header(time_s), "name": list(names), "position": values, "velocity": rates}
        self.add(topic, time_s, JOINT_STATE, state)

    def picture(self, topic: str, time_s: float, frame: str, image: np.ndarray) -> None:
        """Add a picture: JPEG of colours (uint8); depth in mm and numbers of objects + 1 as they are."""
        shown: Values = {"header": header(time_s, frame)}
        if image.dtype == np.uint8:
            shown |= {"format": "jpeg", "data": np.frombuffer(encode(image), np.uint8)}
            self.add(topic, time_s, COMPRESSED_IMAGE, shown)
            return
        height, width = image.shape
        shown |= {"height": height, "width": width, "encoding": "16UC1", "step": 2 * width}
        shown["data"] = whole_numbers(image).astype("<u2").reshape(-1).view(np.uint8)
        self.add(topic, time_s, IMAGE, shown)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Attach a file."""
        self._writer.add_attachment(0, 0, name, media_type, data)

    def add_metadata(self, name: str, entries: Mapping[str, str]) -> None:
        """Add metadata."""
        self._writer.add_metadata(name, dict(entries))

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the file, which appears whole or not at all; nothing can be added after that.

        Raises:
            StorageError: the disk is full or the folder not writable.
        """
        self._writer.finish()
        with storing(Path(path)):
            return write_atomic(path, self._file.getvalue())

    def _schema(self, kind: str) -> int:
        if kind not in self._schemas:
            text, _ = _types().generate_msgdef(kind, ros_version=2)
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", text.encode())
        return self._schemas[kind]


def header(time_s: float, frame: str = "") -> Values:
    """Return the header of a message about a frame."""
    seconds, rest = divmod(int(nanoseconds(np.array(time_s))), 10**9)
    return {"stamp": {"sec": seconds, "nanosec": rest}, "frame_id": frame}


def vector(values: Iterable[float], names: str = "xyzw") -> Values:
    """Return a vector of three, or a quaternion or colour of four numbers by their names."""
    return dict(zip(names, map(float, values), strict=False))


def message(kind: str, values: Values) -> Any:
    """Return a message of the type ``kind`` with these values, inner messages as mappings."""
    _, fields = _types().fielddefs[kind]
    return _types().types[kind](**{name: _part(*of, values.get(name)) for name, of in fields})


def _part(node: Nodetype, of: Any, value: Any) -> Any:
    if node == Nodetype.NAME:
        return message(of, value or {})
    if node == Nodetype.BASE:
        return value if value is not None else "" if of[0] == "string" else 0
    (inner, name), count = of
    if inner == Nodetype.NAME:
        return [message(name, each) for each in value or ()]
    return list(value or ()) if name[0] == "string" else np.array(np.zeros(count) if value is None else value, name[0])


@cache
def _types() -> Typestore:
    return get_typestore(Stores.ROS2_HUMBLE)
