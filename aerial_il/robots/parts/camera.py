"""Cameras that a robot carries, and how one is aimed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from numbers import Integral
from typing import Literal

import mujoco
import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.robots.parts.arm import Arm, Vector
from aerial_il.robots.parts.base import Base

UP, AHEAD, DOWN = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)
LARGEST_IMAGE = (960, 1280)  # height, width, pixels
WIDE_DEG = 75.0
WRIST_DEG, BASE_DEG = 90.0, 95.0  # of cameras beside an arm, see experiments/cameras
NEAR_M = 0.62
BRACKET_M = 0.12  # the base's camera looks past the arm from at least this far to its side


@dataclass(frozen=True)
class Camera:
    """A camera that a robot carries; its images are observations called ``NAME_rgb`` and so on.

    Attributes:
        name: of its own; ``scene`` is the suite's.
        on: ``base``, or ``tool`` for the last link, which is the base of a robot without an arm.
        pos: m, in the frame of that body. forward, up: where it looks and where the image's top is, in that frame.
        fov: degrees from the image's bottom to its top.
        size: height and width of its images, pixels; None for the environment's ``image_size``.

    Raises:
        InvalidValueError: a name that is taken, or a number out of range.
    """

    name: str
    on: Literal["base", "tool"]
    pos: Vector
    forward: Vector
    up: Vector = UP
    fov: float = WIDE_DEG
    size: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        if self.name == "scene" or not self.name.isidentifier():
            raise InvalidValueError(f"A robot's camera has a name of its own such as wrist_left, got {self.name!r}.")
        if self.on not in ("base", "tool"):
            raise InvalidValueError(f"Camera {self.name} is on {self.on!r}; it can be on 'base' or on 'tool'.")
        if not 0.0 < self.fov < 180.0:
            raise InvalidValueError(f"Camera {self.name} has a fov of {self.fov} degrees; it lies between 0 and 180.")
        if np.linalg.norm(np.cross(self.forward, self.up)) < 1e-9:
            raise InvalidValueError(f"Camera {self.name} looks along {self.forward}, which is its up, or nowhere.")
        if self.size is not None:
            check_size(self.size)

    def add_to(self, body: mujoco.MjsBody) -> None:
        """Add the camera to the body that carries it."""
        quat = look_along(np.array(self.forward), up=self.up)
        body.add_camera(name=self.name, pos=self.pos, quat=quat, fovy=self.fov)


def frame_of(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Position (3,) m and rotation (3, 3) of a camera in the frame of the body that carries it."""
    mat = np.empty(9)
    mujoco.mju_quat2Mat(mat, look_along(np.array(camera.forward), up=camera.up))
    return np.array(camera.pos, float), mat.reshape(3, 3)


def check_size(size: Iterable[int]) -> None:
    """Refuse images that are empty or larger than can be rendered.

    Raises:
        InvalidValueError: names the limit.
    """
    sides = list(size) if isinstance(size, Iterable) else []
    whole = len(sides) == 2 and all(isinstance(side, Integral) for side in sides)
    if not whole or not all(0 < side <= most for side, most in zip(sides, LARGEST_IMAGE, strict=True)):
        raise InvalidValueError(f"image_size is (height, width) up to {LARGEST_IMAGE}, got {size}.")


STANDARD = ("wrist", "base")  # what the cameras of a robot are called that declares none


def standard_cameras(base: Base, arm: Arm, tool: Vector, hanging: np.ndarray) -> tuple[Camera, Camera]:
    """Return the cameras of a robot that declares none.

    ``wrist`` looks past the fingers at what they grasp, ``base`` from the base's left at the arm and what is below it.
    On a bare base, ``wrist`` looks ahead and down from its nose and ``base`` straight down from below.

    Args:
        tool: point in the frame of the last link, m. hanging: (3,) where it is with the arm down, base frame, m.
    """
    if not arm.links:
        nose, belly = (base.hub_size[0], 0.0, 0.0), (0.0, 0.0, -base.hub_size[2])
        return Camera("wrist", "tool", nose, (1.0, 0.0, -0.6)), Camera("base", "base", belly, DOWN, up=AHEAD)
    reach = tool[0]
    wrist = np.array([0.1 * reach, 0.0, 0.75 * reach])
    ahead = np.array([1.3 * reach, 0.0, 0.1 * reach]) - wrist
    span = arm.reach
    height = max(-base.hub_size[2], hanging[2] + 0.5 * span)
    pos = np.array([0.25 * span, max(0.4 * span, BRACKET_M), height])
    away = np.array([2.5 * hanging[0], 0.0, 2.0 * hanging[2]]) - pos
    view = min(BASE_DEG, BASE_DEG * NEAR_M / float(np.linalg.norm(hanging - pos)))  # a far gripper: more closely
    return (
        Camera("wrist", "tool", tuple(wrist.tolist()), tuple(ahead.tolist()), fov=WRIST_DEG),
        Camera("base", "base", tuple(pos.tolist()), tuple(away.tolist()), up=AHEAD, fov=view),
    )


def look_along(forward: np.ndarray, up: Vector = UP) -> np.ndarray:
    """Quaternion (w, x, y, z) of a camera that looks along ``forward`` (3,), the image's top towards ``up``.

    Both are in the frame of the body that carries the camera; MuJoCo's cameras look along their own -z.
    """
    z = -np.asarray(forward, float) / np.linalg.norm(forward)
    x = np.cross(up, z)
    x /= np.linalg.norm(x)
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, np.stack([x, np.cross(z, x), z], axis=1).ravel())
    return quat
