"""Forward kinematics from the text of a URDF file, by the specification alone."""

from collections.abc import Mapping
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation


def poses(urdf: str, values: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Return link -> (4, 4) pose in the root link, for joints at ``values``; a floating joint cannot be evaluated."""
    robot = ET.fromstring(urdf.encode())
    held = {_link(joint, "child"): joint for joint in robot.iter("joint")}
    result: dict[str, np.ndarray] = {}

    def pose(link: str) -> np.ndarray:
        if link not in result:
            joint = held.get(link)
            result[link] = np.eye(4) if joint is None else pose(_link(joint, "parent")) @ _held(joint, values)
        return result[link]

    return {str(link.get("name")): pose(str(link.get("name"))) for link in robot.findall("link")}


def _held(joint: ET.Element, values: Mapping[str, float]) -> np.ndarray:
    origin = joint.find("origin")
    assert origin is not None
    matrix = transform(_numbers(origin, "xyz"), Rotation.from_euler("xyz", _numbers(origin, "rpy")))
    kind, axis = joint.get("type"), joint.find("axis")
    if kind == "fixed":
        return matrix
    assert axis is not None
    along = values[str(joint.get("name"))] * _numbers(axis, "xyz")
    if kind == "prismatic":
        return matrix @ transform(along, Rotation.identity())
    assert kind in ("revolute", "continuous")
    return matrix @ transform(np.zeros(3), Rotation.from_rotvec(along))


def transform(pos: np.ndarray, rot: Rotation) -> np.ndarray:
    """Return a pose as a matrix (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rot.as_matrix(), pos
    return matrix


def _link(joint: ET.Element, end: str) -> str:
    element = joint.find(end)
    assert element is not None
    return str(element.get("link"))


def _numbers(element: ET.Element, name: str) -> np.ndarray:
    return np.array(str(element.get(name)).split(), float)
