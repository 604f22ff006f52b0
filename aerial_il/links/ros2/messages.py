"""Fields of observations as standard messages, for people and for the tools of ROS; poses come back as well."""

from array import array
from typing import Any

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.rotations import mat_from_quat, mat_from_rot6d, rot6d_from_mat
from aerial_il.core.specs import EnvSpec, Field
from aerial_il.data.recording.encoding.poses import quat_xyzw
from aerial_il.links.ros2.exact import Obs, camera_of, header
from aerial_il.links.ros2.middleware import ros

WORLD, BASE, TOOL = "world", "base_link", "tool"  # frames
IN_STANDARD = ("base_pos", "base_rot6d", "base_vel", "base_angvel", "joint_pos", "joint_vel", "gripper")
IN_STANDARD += ("ee_pos", "ee_rot6d")  # fields that arrive as odometry, joint states and pose of the tool


def pose(time_s: float, pos: np.ndarray, rot6d: np.ndarray) -> Any:
    """Return a pose in the world of a position (3,), m, and a rotation (6,)."""
    message = ros().PoseStamped(header=header(time_s, WORLD))
    _put(message.pose.position, pos)
    _put(message.pose.orientation, quat_xyzw(np.asarray(rot6d, float)[None])[0], "xyzw")
    return message


def pose_of(pose: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return position (3,), m, and rotation (6,) of a pose or a transform.

    Raises:
        InvalidValueError: the quaternion has not the norm 1, or something is not finite.
    """
    place = pose.position if hasattr(pose, "position") else pose.translation
    turn = pose.orientation if hasattr(pose, "orientation") else pose.rotation
    pos, quat = vector_of(place), np.array([turn.w, turn.x, turn.y, turn.z])
    if not (np.isfinite(pos).all() and np.isfinite(quat).all()):
        raise InvalidValueError("the pose is not finite")
    if abs(norm := float(np.linalg.norm(quat))) - 1.0 > 1e-3 or norm < 1.0 - 1e-3:
        raise InvalidValueError(f"the quaternion's norm is {norm:.4g}, it must be 1")
    return pos, rot6d_from_mat(np.array(mat_from_quat(tuple(quat / norm))))


def vector_of(vector: Any) -> np.ndarray:
    """Return the (3,) of a vector or point."""
    return np.array([vector.x, vector.y, vector.z])


def odometry(time_s: float, obs: Obs) -> Any:
    """Return where the base is and how it moves: the pose in the world, the twist in the base's frame (REP 105)."""
    message = ros().Odometry(header=header(time_s, WORLD), child_frame_id=BASE)
    message.pose.pose = pose(time_s, obs["base_pos"], obs["base_rot6d"]).pose
    _put(message.twist.twist.linear, mat_from_rot6d(obs["base_rot6d"]).T @ obs["base_vel"])
    _put(message.twist.twist.angular, obs["base_angvel"])
    return message


def joint_names(count: int) -> list[str]:
    """Return what the joints of an arm are called: as in the labels of actions."""
    return [f"joint_{i}" for i in range(count)]


def joint_states(time_s: float, obs: Obs) -> Any:
    """Return positions and velocities of the arm; of a gripper its opening, 0 to 1, and no velocity (NaN)."""
    pos, vel = obs.get("joint_pos", np.zeros(0)), obs.get("joint_vel", np.zeros(0))
    names = joint_names(len(pos))
    if "gripper" in obs:
        names, pos, vel = [*names, "gripper"], np.append(pos, obs["gripper"]), np.append(vel, np.nan)
    return ros().JointState(header=header(time_s), name=names, position=array("d", pos), velocity=array("d", vel))


def camera_info(time_s: float, field: Field, fovy_deg: float) -> Any:
    """Return what a pinhole camera without distortion is, of a vertical angle of view."""
    height, width = field.shape[:2]
    focal = 0.5 * height / float(np.tan(0.5 * np.radians(fovy_deg)))
    x, y = 0.5 * width, 0.5 * height
    return ros().CameraInfo(
        header=header(time_s, f"{camera_of(field)}_optical"),
        height=height,
        width=width,
        distortion_model="plumb_bob",
        d=[0.0] * 5,
        k=[focal, 0.0, x, 0.0, focal, y, 0.0, 0.0, 1.0],
        r=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p=[focal, 0.0, x, 0.0, 0.0, focal, y, 0.0, 0.0, 0.0, 1.0, 0.0],
    )


def kind_of(field: Field, spec: EnvSpec) -> Any:
    """Return the class of the message that a field of a task or sensor is shown as.

    A position with a rotation is a pose, a position alone a point, a force a wrench, another vector of three a vector;
    what else there is, numbers with labels.
    """
    if field.size != 3 or field.frame != WORLD:
        return ros().Float64MultiArray
    if field.unit == "N":
        return ros().WrenchStamped
    if not field.name.endswith("_pos"):
        return ros().Vector3Stamped
    return ros().PoseStamped if rotation_of(field) in spec.observation.names else ros().PointStamped


def rotation_of(field: Field) -> str:
    """Return the name of the rotation that belongs to a position."""
    return f"{field.name.removesuffix('_pos')}_rot6d"


def shown(time_s: float, field: Field, obs: Obs, spec: EnvSpec) -> Any:
    """Return a field as a message of :func:`kind_of`."""
    kind, values = kind_of(field, spec), obs[field.name]
    if kind is ros().PoseStamped:
        return pose(time_s, values, obs[rotation_of(field)])
    if kind is ros().Float64MultiArray:
        return labelled(field, values)
    message = kind(header=header(time_s, WORLD))
    parts = {ros().PointStamped: "point", ros().Vector3Stamped: "vector", ros().WrenchStamped: "wrench"}
    part = getattr(message, parts[kind])
    _put(part.force if kind is ros().WrenchStamped else part, values)
    return message


def labelled(field: Field, values: np.ndarray) -> Any:
    """Return numbers, row by row, whose labels are that of the only dimension, with commas."""
    message = ros().Float64MultiArray(data=array("d", np.ravel(values)))
    labels = field.labels or [str(i) for i in range(field.size)]
    message.layout.dim = [ros().MultiArrayDimension(label=",".join(labels), size=field.size, stride=field.size)]
    return message


def _put(message: Any, values: np.ndarray, names: str = "xyz") -> None:
    for name, value in zip(names, values, strict=True):
        setattr(message, name, float(value))
