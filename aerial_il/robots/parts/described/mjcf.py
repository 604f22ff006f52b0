"""MJCF: what refers to other files, stands for many elements or runs code is refused before it is compiled."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import mujoco
import numpy as np

from aerial_il.robots.parts.described.error import ModelFileError
from aerial_il.robots.parts.described.joints import JointFigures
from aerial_il.robots.parts.described.mesh_files import MeshFiles
from aerial_il.robots.parts.described.tree import remove

REFUSED = {
    "include": "it is another file",
    "model": "it is another file",
    "attach": "it stands for another model",
    "plugin": "it runs code",
    "extension": "it runs code",
    "replicate": "it stands for many bodies",
    "composite": "it stands for many bodies",
    "flexcomp": "it stands for many bodies",
    "flex": "it is soft",
    "hfield": "it is ground",
}
UNUSED = ("texture", "skin", "layer", "keyframe", "size", "statistic", "visual", "sensor")
SETTINGS = {"discardvisual": "false", "fusestatic": "false", "balanceinertia": "false"}
FOLDERS = ("meshdir", "assetdir", "texturedir", "boundmass", "boundinertia", "settotalmass", "strippath")
HINGE, BY_JOINT = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtTrn.mjTRN_JOINT)
TIED, WRAPPED = int(mujoco.mjtEq.mjEQ_JOINT), int(mujoco.mjtWrap.mjWRAP_JOINT)


def prepare(root: Element, source: Path, meshes: MeshFiles) -> None:
    """Check an MJCF and make it one that is complete in itself.

    Raises:
        ModelFileError: it holds what stands for files, code or many elements.
    """
    for element in root.iter():
        if element.tag in REFUSED:
            problem = f"<{element.tag}> is not read: {REFUSED[element.tag]}."
            raise ModelFileError(source, f"{problem} Save it as one plain file: MjSpec.to_xml().")
    remove(root, UNUSED)
    for material in root.iter("material"):
        material.attrib.pop("texture", None)
    folder = _mesh_folder(root)
    for mesh in root.iter("mesh"):
        if mesh.get("builtin"):
            raise ModelFileError(source, f"mesh {mesh.get('name')!r} is made by MuJoCo; a file or vertices are read.")
        if reference := mesh.get("file"):
            name = mesh.get("name") or Path(reference).stem
            mesh.set("name", name)
            mesh.set("file", meshes.add(name, f"{folder}{reference}"))
    _refuse_files(root, source)
    for compiler in root.iter("compiler"):
        for word in FOLDERS:
            compiler.attrib.pop(word, None)
    SubElement(root, "compiler", SETTINGS)


def _mesh_folder(root: Element) -> str:
    folder = ""
    for compiler in root.iter("compiler"):
        folder = compiler.get("meshdir") or compiler.get("assetdir") or folder
    return f"{folder.rstrip('/')}/" if folder else ""


def _refuse_files(root: Element, source: Path) -> None:
    for element in root.iter():
        named = [word for word in element.attrib if word.startswith("file")]
        if named and element.tag != "mesh":
            raise ModelFileError(source, f"<{element.tag}> names the file {element.get(named[0])!r}; only meshes may.")


def joint_figures(model: mujoco.MjModel) -> dict[str, JointFigures]:
    """What a compiled model says of its joints that turn."""
    coupled = _coupled(model)
    return {
        model.joint(j).name: _figures(model, j, coupled.get(j, ""))
        for j in range(model.njnt)
        if model.jnt_type[j] == HINGE
    }


def _figures(model: mujoco.MjModel, joint: int, coupled: str) -> JointFigures:
    """Limits of one joint, and what its actuator is: a servo with gains, or a motor with a torque."""
    torque = float(model.jnt_actfrcrange[joint, 1]) if model.jnt_actfrclimited[joint] else None
    stiffness = damping = None
    for i in range(model.nu):
        if model.actuator_trntype[i] != BY_JOINT or model.actuator_trnid[i, 0] != joint:
            continue
        gear, gain, bias = abs(model.actuator_gear[i, 0]), model.actuator_gainprm[i, 0], model.actuator_biasprm[i]
        servo = bias[1] < 0.0
        if model.actuator_forcelimited[i]:
            torque = min(torque or np.inf, gear * float(model.actuator_forcerange[i, 1]))
        elif model.actuator_ctrllimited[i] and not servo:
            torque = min(torque or np.inf, gear * float(gain * model.actuator_ctrlrange[i, 1]))
        if servo:
            stiffness, damping = -(gear**2) * float(bias[1]), -(gear**2) * float(bias[2])
    armature = float(model.dof_armature[model.jnt_dofadr[joint]])
    low, high = (float(value) for value in model.jnt_range[joint])
    bounded = bool(model.jnt_limited[joint]) or low > high  # the wrong way round, MuJoCo takes it for none
    return JointFigures(
        limits=(low, high) if bounded else None,
        torque=torque or None,
        stiffness=stiffness,
        damping=damping or None,
        armature=armature or None,
        coupled=coupled,
    )


def _coupled(model: mujoco.MjModel) -> dict[int, str]:
    """Joints that an equality or a tendon ties to others."""
    found: dict[int, str] = {}
    for i in range(model.neq):
        if int(model.eq_type[i]) == TIED:
            for joint in (model.eq_obj1id[i], model.eq_obj2id[i]):
                found[int(joint)] = "an <equality> ties it to another joint"
    for k in range(model.nwrap):
        if int(model.wrap_type[k]) == WRAPPED:
            found[int(model.wrap_objid[k])] = "a <tendon> ties it to another joint"
    return found
