"""The robot of a compiled scene as URDF: links with inertia, looks and collisions, joints with limits.

Links are called as MuJoCo's bodies, joints as its joints. URDF has no capsules, ellipsoids and embedded meshes:
capsules are cylinders between spheres, ellipsoids a stack of discs, meshes the boxes around them. Speeds have no limit
in the scene, and efforts have one only where an actuator says so: 0 means that none is known.

Source: the URDF specification, wiki.ros.org/urdf/XML.
"""

import warnings
from xml.etree import ElementTree as ET

import mujoco
import numpy as np

from aerial_il.presentation.rerun.ros2.kinematics import CONTINUOUS, FIXED, FLOATING, WORLD, Joint, Pose, Tree
from aerial_il.presentation.rerun.ros2.shapes import BOX, CYLINDER, Shape, shapes_of

ENDLESS_M = 1000.0  # of a slide without limits, which URDF does not have


def urdf_of(model: mujoco.MjModel, tree: Tree, name: str) -> str:
    """Return the text of a URDF file.

    Args:
        model: the scene. tree: its robot. name: of the robot.
    """
    robot = ET.Element("robot", name=name)
    for link in tree.links:
        _add_link(robot, model, link, tree.bodies.get(link))
    for joint in tree.joints:
        _add_joint(robot, model, joint)
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode", xml_declaration=True) + "\n"


def _add_link(robot: ET.Element, model: mujoco.MjModel, name: str, body: int | None) -> None:
    link = ET.SubElement(robot, "link", name=name)
    if body is None or name == WORLD:
        return
    if model.body_mass[body] > 0:
        _add_inertia(link, model, body)
    for number, shape in enumerate(shapes_of(model, body)):
        look = _add_shape(link, "visual", shape)
        material = ET.SubElement(look, "material", name=f"{name}_{number}")
        ET.SubElement(material, "color", rgba=_text(shape.colour))
    for shape in shapes_of(model, body, seen=False):
        _add_shape(link, "collision", shape)


def _add_inertia(link: ET.Element, model: mujoco.MjModel, body: int) -> None:
    inertial = ET.SubElement(link, "inertial")
    _add_origin(inertial, Pose.of(model.body_ipos[body], model.body_iquat[body]))
    ET.SubElement(inertial, "mass", value=_text(model.body_mass[body]))
    xx, yy, zz = map(_text, model.body_inertia[body])
    ET.SubElement(inertial, "inertia", ixx=xx, ixy="0", ixz="0", iyy=yy, iyz="0", izz=zz)


def _add_shape(link: ET.Element, kind: str, shape: Shape) -> ET.Element:
    element = ET.SubElement(link, kind)
    _add_origin(element, shape.pose)
    geometry = ET.SubElement(element, "geometry")
    if shape.kind == BOX:
        ET.SubElement(geometry, BOX, size=_text(shape.size))
    elif shape.kind == CYLINDER:
        ET.SubElement(geometry, CYLINDER, radius=_text(shape.size[0] / 2), length=_text(shape.size[2]))
    else:
        ET.SubElement(geometry, shape.kind, radius=_text(shape.size[0] / 2))
    return element


def _add_joint(robot: ET.Element, model: mujoco.MjModel, joint: Joint) -> None:
    element = ET.SubElement(robot, "joint", name=joint.name, type=joint.kind)
    ET.SubElement(element, "parent", link=joint.parent)
    ET.SubElement(element, "child", link=joint.child)
    _add_origin(element, joint.origin)
    if joint.kind in (FIXED, FLOATING):
        return
    ET.SubElement(element, "axis", xyz=_text(joint.axis))
    assert joint.index is not None
    limits = {"effort": _text(_effort(model, joint.index)), "velocity": "0"}
    if joint.kind != CONTINUOUS:
        low, high = model.jnt_range[joint.index] if model.jnt_limited[joint.index] else (-ENDLESS_M, ENDLESS_M)
        limits |= {"lower": _text(low), "upper": _text(high)}
    ET.SubElement(element, "limit", limits)


def _effort(model: mujoco.MjModel, joint: int) -> float:
    """Return the largest force or torque, N or N m, that actuators may put on a joint; 0 if nobody says."""
    if model.jnt_actfrclimited[joint]:
        return float(np.abs(model.jnt_actfrcrange[joint]).max())
    drives = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT) & (model.actuator_trnid[:, 0] == joint)
    limited = drives & (model.actuator_forcelimited != 0)
    most = np.abs(model.actuator_forcerange[limited]).max(axis=1, initial=0.0)
    return float((most * np.abs(model.actuator_gear[limited, 0])).sum())


def _add_origin(element: ET.Element, pose: Pose) -> None:
    """Add a place: roll, pitch and yaw turn about fixed axes."""
    with warnings.catch_warnings(
        action="ignore", category=UserWarning
    ):  # upright, any roll and yaw of their sum will do
        angles = pose.rot.as_euler("xyz")
    ET.SubElement(element, "origin", xyz=_text(pose.pos), rpy=_text(angles))


def _text(values: np.ndarray | float) -> str:
    """Return numbers with all their digits."""
    return " ".join(repr(float(value) + 0.0) for value in np.atleast_1d(values))
