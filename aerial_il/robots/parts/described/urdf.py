"""URDF: what MuJoCo would pass over, mend or make up, refused or noted before it is compiled.

Format: the Unified Robot Description Format of ROS, http://wiki.ros.org/urdf/XML.
"""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from aerial_il.robots.parts.described.error import ModelFileError
from aerial_il.robots.parts.described.inertia import flaw
from aerial_il.robots.parts.described.joints import JointFigures
from aerial_il.robots.parts.described.mesh_files import MeshFiles
from aerial_il.robots.parts.described.tree import remove

TURNING, RIGID = ("revolute", "continuous"), "fixed"
JOINTS = (*TURNING, "prismatic", RIGID)
UNUSED = ("mujoco", "gazebo", "transmission", "sensor", "mimic", "safety_controller", "texture")
SETTINGS = {"discardvisual": "false", "fusestatic": "false", "inertiafromgeom": "false", "balanceinertia": "false"}
MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
FRAME_KG = (
    1e-5  # up to here a link that no joint moves is a frame, whatever moments are written: SO-ARM101 1e-9, B1 1e-6
)


def prepare(root: Element, source: Path, meshes: MeshFiles) -> dict[str, JointFigures]:
    """Check a URDF, make it one that MuJoCo compiles as it is written, and return its joints that turn.

    Raises:
        ModelFileError: it is a template, its links form no tree, a joint or an inertia is impossible.
    """
    if any("xacro" in element.tag for element in root.iter()):
        raise ModelFileError(source, f"it is a xacro template. Expand it first: xacro {source.name} > arm.urdf")
    links = _named(root, "link", source)
    joints = _named(root, "joint", source)
    _check_tree(links, joints, source)
    found = {name: _figures(joint, source) for name, joint in joints.items() if joint.get("type") in TURNING}
    moved = {_end(joint, "child", source) for joint in joints.values() if joint.get("type") != RIGID}
    if bare := [name for name, link in links.items() if name in moved and link.find("inertial") is None]:
        problem = f"links that joints move have no <inertial>: {', '.join(bare)}."
        raise ModelFileError(source, f"{problem} Give <mass> (kg) and <inertia> (kg m², about the centre of mass).")
    for name, link in links.items():
        _check_inertia(link, name, name in moved, source)
    remove(root, UNUSED)
    for k, mesh in enumerate(root.iter("mesh")):
        file = meshes.add(f"mesh_{k}", mesh.get("filename", ""))
        mesh.set("filename", file)
    SubElement(SubElement(root, "mujoco"), "compiler", SETTINGS)
    return found


def _named(root: Element, tag: str, source: Path) -> dict[str, Element]:
    """Elements of the robot by their names."""
    found: dict[str, Element] = {}
    for element in root.findall(tag):
        name = element.get("name", "")
        if not name or name in found:
            raise ModelFileError(
                source, f"there is a <{tag}> {f'a second time: {name!r}' if name else 'without name'}."
            )
        found[name] = element
    return found


def _check_tree(links: dict[str, Element], joints: dict[str, Element], source: Path) -> None:
    """Require joints of known types that hang every link but one from another one."""
    parents: dict[str, str] = {}
    for name, joint in joints.items():
        kind = joint.get("type", "")
        if kind not in JOINTS:
            raise ModelFileError(source, f"joint {name!r} is of type {kind!r}; those read: {', '.join(JOINTS)}.")
        child, parent = _end(joint, "child", source), _end(joint, "parent", source)
        for end in (child, parent):
            if end not in links:
                raise ModelFileError(source, f"joint {name!r} names the link {end!r}, which is not there.")
        if child in parents:
            raise ModelFileError(source, f"link {child!r} hangs from two joints; an arm is a tree without loops.")
        parents[child] = parent
    roots = [name for name in links if name not in parents]
    if len(roots) != 1:
        found = ", ".join(roots) or "none"
        raise ModelFileError(source, f"exactly one link may hang from no other, and here do: {found}.")


def _end(joint: Element, end: str, source: Path) -> str:
    found = joint.find(end)
    if found is None or not found.get("link"):
        raise ModelFileError(source, f"joint {joint.get('name')!r} has no <{end} link=...>.")
    return str(found.get("link"))


def _figures(joint: Element, source: Path) -> JointFigures:
    """Limits, torque and speed of a joint that turns."""
    name, limit = joint.get("name"), joint.find("limit")
    axis = _numbers(joint.find("axis"), "xyz", 3, source, f"joint {name!r}", "1 0 0")
    if not np.linalg.norm(axis):
        raise ModelFileError(source, f"the axis of joint {name!r} is 0 0 0; give its direction, e.g. 0 1 0.")
    if limit is None and joint.get("type") == "revolute":
        raise ModelFileError(source, f"joint {name!r} is revolute and has no <limit lower= upper= effort= velocity=>.")
    where = f"the limit of joint {name!r}"
    low, high, torque, speed = (
        _number(limit, word, source, where) for word in ("lower", "upper", "effort", "velocity")
    )
    bounded = joint.get("type") == "revolute"
    if bounded and low >= high:
        raise ModelFileError(source, f"joint {name!r} turns from {low:g} to {high:g} rad: lower must be below upper.")
    mimic = joint.find("mimic")
    return JointFigures(
        limits=(low, high) if bounded else None,
        torque=torque or None,
        speed=speed or None,
        coupled="" if mimic is None else f"it mimics {mimic.get('joint')!r}",
    )


def _check_inertia(link: Element, name: str, moved: bool, source: Path) -> None:
    """Require the inertia of a solid; a frame, which no joint moves, needs none and is left without."""
    inertial = link.find("inertial")
    if inertial is None:
        return
    where = f"the inertial of link {name!r}"
    mass = _number(inertial.find("mass"), "value", source, where)
    xx, yy, zz, xy, xz, yz = (_number(inertial.find("inertia"), moment, source, where) for moment in MOMENTS)
    if not moved and 0.0 <= mass <= FRAME_KG and (mass > 0.0 or not any((xx, yy, zz, xy, xz, yz))):
        link.remove(inertial)  # how some tools and manufacturers write a frame
        return
    if problem := flaw(mass, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])):
        raise ModelFileError(source, f"no solid is like link {name!r}: {problem}.")


def _number(element: Element | None, word: str, source: Path, where: str) -> float:
    """A finite number of an element; 0 where it does not say, as the format has it."""
    return float(_numbers(element, word, 1, source, where, "0")[0])


def _numbers(element: Element | None, word: str, count: int, source: Path, where: str, default: str) -> np.ndarray:
    text = default if element is None else element.get(word, default)
    try:
        values = np.array([float(part) for part in text.split()])
    except ValueError:
        values = np.array([math.nan])
    if values.shape != (count,) or not np.isfinite(values).all():
        numbers = "a finite number" if count == 1 else f"{count} finite numbers"
        raise ModelFileError(source, f"{word} of {where} is not {numbers}: {text!r}.")
    return values
