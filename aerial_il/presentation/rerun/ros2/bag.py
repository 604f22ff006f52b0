"""Files that the tools of ROS 2 read: MCAP with standard messages alone.

They are made for looking at flights, in Foxglove, RViz or rerun, and are derived from recordings, which they do not
replace. Stamps are simulation time.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.writer import Writer
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from aerial_il.core.files import write_atomic
from aerial_il.data.recording.container import LIBRARY
from aerial_il.data.recording.encoding.images import encode, whole_numbers
from aerial_il.data.recording.encoding.messages import (
    COMPRESSED_IMAGE,
    FLOAT_ARRAY,
    JOINT_STATE,
    POSE_STAMPED,
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
Numbers = np.ndarray | Sequence[float]


class Frame(NamedTuple):
    """A frame in another one: its place (3,) in m, and its quaternion (4,) x y z w."""

    parent: str
    name: str
    pos: np.ndarray
    xyzw: np.ndarray


class Marker(NamedTuple):
    """A solid that stays in a frame: ``kind`` is box, sphere or cylinder; ``size`` (3,) m; ``colour`` (4,) 0 to 1."""

    frame: Frame
    kind: str
    size: np.ndarray
    colour: np.ndarray


class Lens(NamedTuple):
    """A camera without distortion: the size of its pictures, and its focal length, all in pixels."""

    width: int
    height: int
    focal: float


class Bag:
    """The messages of one flight, in the order of their times; :meth:`save` makes the file.

    A method that adds a message takes its topic, its time in s, and what it says.
    """

    def __init__(self) -> None:
        self._file = io.BytesIO()
        self._writer = Writer(self._file, chunk_size=1 << 18, enable_data_crcs=True)
        self._writer.start(profile="ros2", library=LIBRARY)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}

    def frames(self, topic: str, time_s: float, frames: Iterable[Frame], *, lasting: bool = False) -> None:
        """Add where frames are; ``lasting``: for ever."""
        stamped = [
            _make(
                "geometry_msgs/msg/TransformStamped",
                header=_header(time_s, frame.parent),
                child_frame_id=frame.name,
                transform=_make(
                    "geometry_msgs/msg/Transform", translation=_vector(frame.pos), rotation=_quaternion(frame.xyzw)
                ),
            )
            for frame in frames
        ]
        self._add(topic, time_s, _make(TF_MESSAGE, transforms=stamped), lasting=lasting)

    def pose(self, topic: str, time_s: float, frame: Frame) -> None:
        """Add the pose of something."""
        self._add(topic, time_s, _make(POSE_STAMPED, header=_header(time_s, frame.parent), pose=_pose(frame)))

    def named(self, topic: str, time_s: float, names: Sequence[str], values: Numbers, rates: Numbers = ()) -> None:
        """Add named numbers, and how fast they change, as the state of joints."""
        position, velocity, effort = (np.array(part, float) for part in (values, rates, ()))
        header = _header(time_s)
        state = _make(JOINT_STATE, header=header, name=list(names), position=position, velocity=velocity, effort=effort)
        self._add(topic, time_s, state)

    def number(self, topic: str, time_s: float, value: float) -> None:
        """Add a number."""
        layout = _make("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
        self._add(topic, time_s, _make(FLOAT_ARRAY, layout=layout, data=np.array([value], float)))

    def text(self, topic: str, time_s: float, text: str) -> None:
        """Add a text that lasts."""
        self._add(topic, time_s, _make(STRING, data=text), lasting=True)

    def camera(self, topic: str, time_s: float, frame: str, lens: Lens) -> None:
        """Add how a camera sees: its frame has x to the right, y down, z ahead."""
        focal, (cx, cy) = lens.focal, (lens.width / 2, lens.height / 2)
        message = _make(
            CAMERA_INFO,
            header=_header(time_s, frame),
            height=lens.height,
            width=lens.width,
            distortion_model="plumb_bob",
            d=np.zeros(5),
            k=np.array([focal, 0, cx, 0, focal, cy, 0, 0, 1]),
            r=np.eye(3).reshape(-1),
            p=np.array([focal, 0, cx, 0, 0, focal, cy, 0, 0, 0, 1, 0]),
            binning_x=0,
            binning_y=0,
            roi=_make("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False),
        )
        self._add(topic, time_s, message)

    def picture(self, topic: str, time_s: float, frame: str, image: np.ndarray) -> None:
        """Add a picture: JPEG of colours (uint8); depth in mm and numbers of objects + 1 as they are."""
        header = _header(time_s, frame)
        if image.dtype == np.uint8:
            data = np.frombuffer(encode(image), np.uint8)
            self._add(topic, time_s, _make(COMPRESSED_IMAGE, header=header, format="jpeg", data=data))
            return
        height, width = image.shape
        message = _make(
            IMAGE,
            header=header,
            height=height,
            width=width,
            encoding="16UC1",
            is_bigendian=0,
            step=2 * width,
            data=whole_numbers(image).astype("<u2").reshape(-1).view(np.uint8),
        )
        self._add(topic, time_s, message)

    def markers(self, topic: str, time_s: float, markers: Sequence[Marker]) -> None:
        """Add solids that stay in their frames."""
        made = [_marker(number, time_s, marker) for number, marker in enumerate(markers)]
        self._add(topic, time_s, _make(MARKERS, markers=made), lasting=True)

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

    def _add(self, topic: str, time_s: float, message: Any, *, lasting: bool = False) -> None:
        kind, time = message.__msgtype__, int(nanoseconds(np.array(time_s)))
        if topic not in self._channels:
            service = {"offered_qos_profiles": LASTING} if lasting else {}
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schema(kind), service)
        data = bytes(_types().serialize_cdr(message, kind))
        self._writer.add_message(self._channels[topic], log_time=time, publish_time=time, data=data)

    def _schema(self, kind: str) -> int:
        if kind not in self._schemas:
            text, _ = _types().generate_msgdef(kind, ros_version=2)
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", text.encode())
        return self._schemas[kind]


@cache
def _types() -> Typestore:
    return get_typestore(Stores.ROS2_HUMBLE)


def _make(kind: str, **values: Any) -> Any:
    return _types().types[kind](**values)


def _header(time_s: float, frame: str = "") -> Any:
    seconds, rest = divmod(int(nanoseconds(np.array(time_s))), 10**9)
    return _make(
        "std_msgs/msg/Header", stamp=_make("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest), frame_id=frame
    )


def _vector(xyz: Numbers, kind: str = "geometry_msgs/msg/Vector3") -> Any:
    return _make(kind, x=float(xyz[0]), y=float(xyz[1]), z=float(xyz[2]))


def _quaternion(xyzw: Numbers) -> Any:
    x, y, z, w = map(float, xyzw)
    return _make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


def _pose(frame: Frame) -> Any:
    position = _vector(frame.pos, "geometry_msgs/msg/Point")
    return _make("geometry_msgs/msg/Pose", position=position, orientation=_quaternion(frame.xyzw))


def _marker(number: int, time_s: float, marker: Marker) -> Any:
    kind: Any = _types().types["visualization_msgs/msg/Marker"]
    shapes = {"box": kind.CUBE, "sphere": kind.SPHERE, "cylinder": kind.CYLINDER}
    r, g, b, a = map(float, marker.colour)
    picture = _make(COMPRESSED_IMAGE, header=_header(0.0), format="", data=np.zeros(0, np.uint8))
    return kind(
        header=_header(time_s, marker.frame.parent),
        ns=marker.frame.name,
        id=number,
        type=shapes[marker.kind],
        action=kind.ADD,
        pose=_pose(marker.frame),
        scale=_vector(marker.size),
        color=_make("std_msgs/msg/ColorRGBA", r=r, g=g, b=b, a=a),
        lifetime=_make("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
        frame_locked=True,
        points=[],
        colors=[],
        texture_resource="",
        texture=picture,
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=_make("visualization_msgs/msg/MeshFile", filename="", data=np.zeros(0, np.uint8)),
        mesh_use_embedded_materials=False,
    )
