"""Observations, images and actions as messages that keep every bit: what policies see and do.

Named numbers are float64 under their labels. Nothing here needs a simulator, as little as who flies a robot does.
"""

from array import array
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec, Field
from aerial_il.links.link import Order
from aerial_il.links.ros2.middleware import ros

NAMESPACE = "/aerial"
NUMBERS = {Order.TAKE_OFF: ("height_m", "take_off_height"), Order.RESET: ("seed", "seed")}  # of orders, and parameters
ENCODINGS = {"uint8": "rgb8", "float32": "32FC1", "int32": "32SC1"}  # of images, by their dtype
Obs = Mapping[str, np.ndarray]


def stamp(time_s: float) -> Any:
    """Return a time, s, as a message."""
    seconds, rest = divmod(round(time_s * 1e9), 10**9)
    return ros().Time(sec=seconds, nanosec=rest)


def header(time_s: float, frame: str = "") -> Any:
    """Return the header of a message about a frame."""
    return ros().Header(stamp=stamp(time_s), frame_id=frame)


def named(time_s: float, labels: Sequence[str], values: np.ndarray) -> Any:
    """Return named numbers (k,), exactly, as the state of joints."""
    return ros().JointState(header=header(time_s), name=list(labels), position=array("d", np.asarray(values, float)))


def observation(time_s: float, spec: EnvSpec, obs: Obs) -> Any:
    """Return all fields that are no images, named element by element as ``field.label``."""
    names = spec.observation.state_names
    return named(time_s, observation_labels(spec), spec.observation.flatten(obs, names))


def observation_labels(spec: EnvSpec) -> list[str]:
    """Return the names in :func:`observation`, in their order."""
    names = spec.observation.state_names
    return [label for name in names for label in spec.observation[name].element_labels()]


def fields_of(message: Any, spec: EnvSpec) -> dict[str, np.ndarray]:
    """Return the fields of an :func:`observation`, as they were.

    Raises:
        InvalidValueError: it has other fields than the specification.
    """
    if list(message.name) != observation_labels(spec) or len(message.position) != len(message.name):
        differ = sorted(set(message.name) ^ set(observation_labels(spec)))
        raise InvalidValueError(f"The observation has other fields than the description: {', '.join(differ[:5])}.")
    values, wanted = np.array(message.position), spec.observation
    return {
        name: values[part].reshape(wanted[name].shape).astype(wanted[name].dtype)
        for name, part in wanted.parts(wanted.state_names).items()
    }


def image(time_s: float, field: Field, values: np.ndarray) -> Any:
    """Return an image: colours ``rgb8``, depth in m ``32FC1``, numbers of objects ``32SC1``."""
    height, width = field.shape[:2]
    data = np.ascontiguousarray(values, np.dtype(field.dtype).newbyteorder("<")).tobytes()
    return ros().Image(
        header=header(time_s, f"{camera_of(field)}_optical"),
        height=height,
        width=width,
        encoding=ENCODINGS[field.dtype],
        step=len(data) // height,
        data=array("B", data),
    )


def image_of(message: Any, field: Field) -> np.ndarray:
    """Return the image of a message, as it was.

    Raises:
        InvalidValueError: it is not of the field's size and kind.
    """
    wanted = (*field.shape[:2], ENCODINGS.get(field.dtype))
    if (message.height, message.width, message.encoding) != wanted:
        shown = (message.height, message.width, message.encoding)
        raise InvalidValueError(f"{field.name} arrives as {shown}, described was {wanted}.")
    order = ">" if message.is_bigendian else "<"
    values = np.frombuffer(message.data, np.dtype(field.dtype).newbyteorder(order))
    return values.reshape(field.shape).astype(field.dtype)


def camera_of(field: Field) -> str:
    """Return the camera that an image is from."""
    return field.frame.removeprefix("camera ") or field.name
