"""A phone that is moved in the hand, with a clutch: only what it does while its button is held moves the vehicle.

Its page sends where it is, over the socket of the page: a viewer's pose of WebXR (position in m and orientation as
x, y, z, w, in a frame with y up; w3.org/TR/webxr, XRRigidTransform), or where there is none the angles of its
orientation sensor (degrees, intrinsic Z-X'-Y'' from an earth frame with z up; w3.org/TR/orientation-event), which know
no position. The phone's own axes are the same in both: x to the right of its screen, y to its top, z out of it. Both
ask for a page over https.

Ahead is where the phone points when its clutch is closed: its top edge if it lies flat, its back if it stands. Opening
the clutch, moving the hand back and closing it again centres it anew, however far the vehicle is to go.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from aerial_il.core.rotations import (
    mat_from_axis_angle,
    mat_from_quat,
    mat_from_yaw,
    matmul,
    rotate,
    rotate_back,
    rotvec_from_mat,
    sub,
)
from aerial_il.teleop.input.frame import PHONE_AXES
from aerial_il.teleop.piloting.command import Vec3

CLUTCH = "phone:clutch"
CONTROLS = (CLUTCH, "phone:close", "phone:open", "phone:precision")
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
Z_UP = (1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0)  # from WebXR's frame, y up, to one with z up
REACH_M = 1.0  # as far as one clutch goes
JUMP_M, JUMP_RAD = 0.25, 0.8  # between two messages: the phone has lost track of itself


@dataclass(frozen=True)
class Pose:
    """Where a phone is, in a frame of its own with z up.

    Attributes:
        pos: m. rot: rotation matrix, nine numbers row by row, of the phone's axes.
    """

    pos: Vec3
    rot: tuple[float, ...]

    @property
    def heading(self) -> float:
        """Where it points, rad: its top edge and its back together, whichever of them is level."""
        ahead = rotate(self.rot, (0.0, 1.0, -1.0))
        return math.atan2(ahead[1], ahead[0])


def pose_of(raw: Mapping[str, Any]) -> Pose:
    """Return the pose that a page has sent.

    Raises:
        ValueError: it has sent something else.
    """
    if set(raw) == {"position", "orientation"}:
        x, y, z = _numbers(raw["position"], 3, 1e3)
        qx, qy, qz, qw = _numbers(raw["orientation"], 4, 1.01)
        length = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
        if not 0.9 < length < 1.1:
            raise ValueError("orientation")
        turned = mat_from_quat((qw / length, qx / length, qy / length, qz / length))
        return Pose((x, -z, y), matmul(Z_UP, turned))
    if set(raw) == {"angles"}:
        alpha, beta, gamma = (math.radians(angle) for angle in _numbers(raw["angles"], 3, 360.0))
        turned = matmul(mat_from_axis_angle(Z, alpha), mat_from_axis_angle(X, beta))
        return Pose((0.0, 0.0, 0.0), matmul(turned, mat_from_axis_angle(Y, gamma)))
    raise ValueError("pose")


class Phone:
    """Turns poses into how far the phone was moved since its clutch was closed."""

    def __init__(self) -> None:
        self.let_go()

    def let_go(self) -> None:
        """Open the clutch."""
        self._start: Pose | None = None
        self._last: Pose | None = None
        self._axes: dict[str, float] = dict.fromkeys(PHONE_AXES, 0.0)

    def move(self, pose: Pose | None, *, clutched: bool, closed_now: bool) -> tuple[dict[str, float], bool]:
        """Return the axes after a message, and whether the phone was centred anew.

        Args:
            pose: where it is; None if it does not know. clutched: whether the clutch is held. closed_now: whether it
                was closed since the last message.
        """
        if not clutched or closed_now:
            self.let_go()
        if not clutched or pose is None:
            return dict(self._axes), False
        anew = self._start is None or self._last is None or _jumped(self._last, pose)
        if anew:
            self._start = pose
        assert self._start is not None
        self._last = pose
        self._axes = _moved(self._start, pose)
        return dict(self._axes), anew


def _moved(start: Pose, now: Pose) -> dict[str, float]:
    """Return the axes: metres ahead, left and up of where ``start`` pointed, and the rotation vector over π."""
    level = mat_from_yaw(start.heading)
    place = rotate_back(level, sub(now.pos, start.pos))
    turn = rotate_back(level, _turn(start.rot, now.rot))
    values = [*(part / REACH_M for part in place), *(part / math.pi for part in turn)]
    return {name: max(-1.0, min(1.0, value)) for name, value in zip(PHONE_AXES, values, strict=True)}


def _turn(before: tuple[float, ...], after: tuple[float, ...]) -> Vec3:
    """Return the rotation vector, about fixed axes, that leads from one to the other."""
    a, b = np.reshape(after, (3, 3)), np.reshape(before, (3, 3))
    x, y, z = rotvec_from_mat(tuple(float(value) for value in (a @ b.T).ravel()))
    return float(x), float(y), float(z)


def _jumped(before: Pose, after: Pose) -> bool:
    return math.dist(before.pos, after.pos) > JUMP_M or math.hypot(*_turn(before.rot, after.rot)) > JUMP_RAD


def _numbers(raw: Any, count: int, most: float) -> list[float]:
    if not isinstance(raw, list) or len(raw) != count:
        raise ValueError("pose")
    for value in raw:
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= most:
            raise ValueError("pose")
    return [float(value) for value in raw]
