"""Where a robot's cameras are, by its own kinematics, and how a point in the world lies in their images."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from aerial_il import robots
from aerial_il.core.contracts import Observation
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.rotations import mat_from_quat
from aerial_il.core.scene_gate import compiled
from aerial_il.core.specs import EnvSpec, camera_name
from aerial_il.policies.parts.relative import rotations
from aerial_il.robots.parts.camera import frame_of, look_along

MOUNTS: Mapping[str, tuple[str, str]] = {"base": ("base_pos", "base_rot6d"), "tool": ("ee_pos", "ee_rot6d")}
NEAREST_M = 0.02  # what is nearer than that to the lens, or behind it, is not seen


@dataclass(frozen=True, eq=False)
class Pose:
    """Poses of a camera in n worlds: ``rot`` (n, 3, 3) world from camera, ``pos`` (n, 3) m.

    Its axes are those of its image: to the right, up, and back towards whoever looks.
    """

    rot: np.ndarray
    pos: np.ndarray

    def seen(self, points: np.ndarray) -> np.ndarray:
        """Return points (n, 3) of the world as (right, up, depth), m."""
        own = np.einsum("nji,nj->ni", self.rot, points - self.pos)
        own[:, 2] *= -1.0
        return own

    def placed(self, own: np.ndarray) -> np.ndarray:
        """Undo :meth:`seen`."""
        return self.pos + np.einsum("nij,nj->ni", self.rot, own * (1.0, 1.0, -1.0))


@dataclass(frozen=True, eq=False)
class Camera:
    """A calibrated camera of a robot.

    Attributes:
        image: field of its images. mount: what carries it. rot (3, 3), pos (3,) m: in the frame of that, the tool's own
            where it is the tool. slope: of the ray through the middle of the image's upper edge. aspect: width by
            height.
    """

    image: str
    mount: Literal["base", "tool"]
    rot: np.ndarray
    pos: np.ndarray
    slope: float
    aspect: float

    @staticmethod
    def of(spec: EnvSpec, image: str) -> Camera:
        """Return the camera that takes an image of ``spec``.

        Raises:
            InvalidValueError: nobody knows where it is: not a robot of the suite, a camera that stands in the scene, or
                one on a base that does not tell where it stands.
        """
        name, (height, width) = camera_name(image), spec.observation[image].shape[:2]
        try:
            robot = robots.get(spec.robot)
        except UnknownNameError as error:
            raise InvalidValueError(
                f"Where the camera of {image!r} is on {spec.robot!r} is not known, and so nothing can be measured in "
                "its images. Register the robot with its cameras: aerial-il new robot NAME."
            ) from error
        carried = {camera.name: camera for camera in robot.mounted_cameras}
        if name not in carried:
            raise InvalidValueError(
                f"{image!r} is not taken by a camera that {spec.robot} carries ({', '.join(carried) or 'none'}); a "
                "camera that stands in the scene is not on board."
            )
        camera = carried[name]
        if not {*MOUNTS[camera.on]} <= {*spec.observation.names}:
            raise InvalidValueError(
                f"{image!r} is taken by a camera on the base of {spec.robot}, which does not tell where that stands: "
                "nothing can be measured in its images. Look through a camera of the tool, policy.images=[wrist_rgb]."
            )
        quat = look_along(np.array(camera.forward), up=camera.up)
        offset = np.array(robot.tool_offset) if camera.on == "tool" else np.zeros(3)
        rot = np.reshape(mat_from_quat(tuple(quat)), (3, 3))
        return Camera(
            image, camera.on, rot, np.array(camera.pos) - offset, np.tan(0.5 * np.deg2rad(camera.fov)), width / height
        )

    def pose(self, obs: Observation) -> Pose:
        """Return where it is in n worlds, by what the robot knows of itself."""
        pos, rot6d = (obs[name] for name in MOUNTS[self.mount])
        rot = rotations(rot6d)
        return Pose(rot @ self.rot, pos + rot @ self.pos)

    def project(self, own: np.ndarray) -> np.ndarray:
        """Return (across, up, log depth) of points (n, 3) as :meth:`Pose.seen` has them; ±1 at the image's edges."""
        depth = np.maximum(own[:, 2], NEAREST_M)
        half = self.slope * depth
        return np.stack([own[:, 0] / (half * self.aspect), own[:, 1] / half, np.log(depth)], axis=1)

    def unproject(self, image: np.ndarray) -> np.ndarray:
        """Undo :meth:`project`, for what is in front of the lens."""
        depth = np.exp(image[:, 2])
        half = self.slope * depth
        return np.stack([image[:, 0] * half * self.aspect, image[:, 1] * half, depth], axis=1)

    def spread(self, image: np.ndarray, sigma: np.ndarray) -> np.ndarray:
        """Return covariances (n, 3, 3) m² in the camera's axes of what ``sigma`` (n, 3) says of ``image`` (n, 3)."""
        depth = np.exp(image[:, 2])
        half = self.slope * depth
        zero = np.zeros_like(depth)
        across = np.stack([half * self.aspect * sigma[:, 0], zero, zero], axis=1)
        up = np.stack([zero, half * sigma[:, 1], zero], axis=1)
        ray = np.stack([image[:, 0] * half * self.aspect, image[:, 1] * half, depth], axis=1)
        jacobian = np.stack([across, up, ray * sigma[:, 2:]], axis=2) * np.array([1.0, 1.0, -1.0])[:, None]
        return jacobian @ np.swapaxes(jacobian, 1, 2)

    def in_view(self, own: np.ndarray) -> np.ndarray:
        """Return which (n,) bool of the points lie within the image; whether something hides them is not asked."""
        across, up = self.project(own)[:, :2].T
        return (own[:, 2] > NEAREST_M) & (np.abs(across) < 1.0) & (np.abs(up) < 1.0)

    def differs(self, other: Camera) -> str:
        """Return in words how another camera of the same name is not this one; nothing if it is."""
        if (self.mount, round(self.slope, 6)) != (other.mount, round(other.slope, 6)):
            mine, theirs = (
                f"{np.rad2deg(2.0 * np.arctan(each.slope)):.0f} degrees on the {each.mount}" for each in (self, other)
            )
            return f"{self.image} is taken with {theirs}, not {mine}"
        if np.allclose(self.pos, other.pos, atol=1e-6) and np.allclose(self.rot, other.rot, atol=1e-6):
            return ""
        return f"the camera of {self.image} is elsewhere, or looks elsewhere"

    def to_dict(self) -> dict[str, Any]:
        """Return plain values."""
        numbers = {"rot": self.rot.tolist(), "pos": self.pos.tolist(), "slope": float(self.slope)}
        return {"image": self.image, "mount": self.mount, **numbers, "aspect": float(self.aspect)}

    @staticmethod
    def from_dict(raw: Mapping[str, Any]) -> Camera:
        """Undo :meth:`to_dict`."""
        rot, pos = np.array(raw["rot"], float).reshape(3, 3), np.array(raw["pos"], float)
        return Camera(raw["image"], raw["mount"], rot, pos, float(raw["slope"]), float(raw["aspect"]))


def changed_cameras(model_xml: str, robot: str, names: Iterable[str]) -> str:
    """Return in words how cameras of a recorded scene are not those that the robot has now; nothing if they are.

    Args:
        model_xml: of the scene; nothing is said of none. robot: its name. names: of the cameras that matter; those that
            it does not carry do not.
    """
    mounted = {camera.name: camera for camera in robots.get(robot).mounted_cameras if camera.name in {*names}}
    if not model_xml or not mounted:
        return ""
    recorded, found = compiled(model_xml), list[str]()
    for name, now in mounted.items():
        then, turned, (place, turn) = recorded.cam(name), np.empty(9), frame_of(now)
        mujoco.mju_quat2Mat(turned, then.quat)
        pairs = {"fov": (then.fovy, now.fov), "pos": (then.pos, place), "axes": (turned, turn.ravel())}
        found += [
            f"{name}: {what} {_said(was)}, now {_said(is_)}"
            for what, (was, is_) in pairs.items()
            if not np.allclose(was, is_, atol=1e-5)
        ]
    return "; ".join(found)


def _said(numbers: ArrayLike) -> str:
    return " ".join(f"{number:.4g}" for number in np.ravel(numbers))
