"""A model file, compiled: its bodies, joints and shapes, and what was left out of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from aerial_il.core.scene_gate import COMPILE_ERRORS, try_compiling
from aerial_il.robots.parts.described import hull, mjcf, urdf
from aerial_il.robots.parts.described.error import ModelFileError
from aerial_il.robots.parts.described.inertia import RigidBody
from aerial_il.robots.parts.described.joints import JointFigures
from aerial_il.robots.parts.described.mesh_files import MeshFiles
from aerial_il.robots.parts.described.shape import PRIMITIVES, Geom, collides
from aerial_il.robots.parts.described.tree import read_tree

HINGE, SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
MOST_VERTICES = 20_000  # of all meshes: scenes are kept as text, in every recording


@dataclass(frozen=True, eq=False)
class Model:
    """A compiled model file.

    Attributes:
        source: the file. compiled: MuJoCo's model. joints: those that turn, by name.
        missing: meshes that are not there -> why.
    """

    source: Path
    compiled: mujoco.MjModel
    joints: dict[str, JointFigures]
    missing: dict[str, str]

    def error(self, problem: str) -> ModelFileError:
        """An error that names the file."""
        return ModelFileError(self.source, problem)

    def body(self, name: str, what: str) -> int:
        """Number of a body, called a link in a URDF; ``what`` it is wanted for."""
        for body in range(1, self.compiled.nbody):
            if self.name(body) == name:
                return body
        found = ", ".join(self.name(body) for body in range(1, self.compiled.nbody))
        raise self.error(f"there is no link {name!r} for {what}. Links: {found}.")

    def name(self, body: int) -> str:
        return self.compiled.body(body).name or f"body {body} (without name)"

    def parent(self, body: int) -> int:
        return int(self.compiled.body_parentid[body])

    def children(self, body: int) -> list[int]:
        return [child for child in range(1, self.compiled.nbody) if self.parent(child) == body]

    def only_root(self, what: str, option: str) -> int:
        """The body that hangs from no other; where there are several ``what``, ``option`` is to choose one."""
        roots = self.children(0)
        if len(roots) != 1:
            names = ", ".join(sorted(self.name(body) for body in roots)) or "none"
            raise self.error(f"it holds {len(roots)} {what}: {names}. Choose one with {option}=....")
        return roots[0]

    def below(self, body: int) -> list[int]:
        """A body and all that hangs from it, parents first."""
        found = [body]
        for child in range(body + 1, self.compiled.nbody):
            if self.parent(child) in found:
                found.append(child)
        return found

    def joints_of(self, body: int) -> list[int]:
        first = int(self.compiled.body_jntadr[body])
        return list(range(first, first + int(self.compiled.body_jntnum[body])))

    def geoms_of(self, body: int) -> list[int]:
        """Its geoms, without those whose mesh is not there.

        Raises:
            ModelFileError: something collides with a mesh that is not there, or a geom is of no use for a robot.
        """
        first = int(self.compiled.body_geomadr[body])
        return [
            geom for geom in range(first, first + int(self.compiled.body_geomnum[body])) if self._usable(body, geom)
        ]

    def _usable(self, body: int, geom: int) -> bool:
        kind, link = Geom(int(self.compiled.geom_type[geom])), self.name(body)
        if kind in PRIMITIVES:
            return True
        if kind != Geom.mjGEOM_MESH:
            problem = f"link {link!r} has a geom of type {kind.name.removeprefix('mjGEOM_').lower()}"
            raise ModelFileError(self.source, f"{problem}; a link is made of primitives and meshes.")
        why = self.missing.get(self.compiled.mesh(int(self.compiled.geom_dataid[geom])).name)
        if why and collides(self.compiled, geom):
            raise self.error(f"link {link!r} collides as a mesh that cannot be read: {why}.")
        return why is None

    @property
    def coarse(self) -> bool:
        """Whether its meshes are too fine for a scene, and stand there as hulls of few points."""
        return self.compiled.nmeshvert > MOST_VERTICES

    def mesh_notes(self) -> list[str]:
        """What became of meshes that are not there, or too fine, a clause each."""
        found = [f"looks are left out: {why}" for why in self.missing.values()]
        if self.coarse:
            found.append(
                f"its meshes have {self.compiled.nmeshvert} vertices, and {MOST_VERTICES} is the most: those of more "
                f"than {hull.POINTS} are the convex hulls of so many of their points, in pictures too. Thinned out, "
                "e.g. with Blender's Decimate, they keep their looks"
            )
        return found

    def data(self, values: dict[int, float]) -> mujoco.MjData:
        """Return the state in which the joints of these numbers are turned by angles (rad), the others by none."""
        data = mujoco.MjData(self.compiled)
        for joint in range(self.compiled.njnt):
            if int(self.compiled.jnt_type[joint]) in (HINGE, SLIDE):
                data.qpos[self.compiled.jnt_qposadr[joint]] = values.get(joint, 0.0)
        mujoco.mj_kinematics(self.compiled, data)
        return data

    def rigid_body(self, data: mujoco.MjData, body: int) -> RigidBody:
        """Mass and inertia of one body along the axes of the world."""
        axes = data.ximat[body].reshape(3, 3)
        tensor = axes @ np.diag(self.compiled.body_inertia[body]) @ axes.T
        return RigidBody(float(self.compiled.body_mass[body]), data.xipos[body].copy(), tensor)


def read_model(path: str | Path, meshes: str | Path | None = None, *, frame: str | None = None) -> Model:
    """Read and compile a URDF or MJCF.

    Args:
        path: the file; what it holds is data, nothing of it is run.
        meshes: folder that holds its meshes, the file's own if None. Nothing outside of it is opened.
        frame: what must be a body: an MJCF's site of that name becomes one.

    Raises:
        ModelFileError: it cannot be read, or describes nothing that can be built.
    """
    source = Path(path)
    root = read_tree(source)
    files = MeshFiles(source, Path(meshes) if meshes else source.parent)
    joints: dict[str, JointFigures] = {}
    if root.tag == "robot":
        joints = urdf.prepare(root, source, files)
    elif root.tag == "mujoco":
        mjcf.prepare(root, source, files, frame)
    else:
        raise ModelFileError(source, f"it begins with <{root.tag}>: neither URDF (<robot>) nor MJCF (<mujoco>).")
    compiled = _compiled(root, source, files)
    if root.tag == "mujoco":
        _refuse_guessed_inertia(compiled, source, files)
        joints = mjcf.joint_figures(compiled)
    least = int(np.minimum(compiled.mesh_vertnum, hull.POINTS).sum())
    if least > MOST_VERTICES:
        problem = (
            f"its {compiled.nmesh} meshes have {least} vertices even as coarse hulls, and {MOST_VERTICES} is the most."
        )
        raise ModelFileError(
            source, f"{problem} Leave the links away that are not the robot's, or <visual> in the file."
        )
    return Model(source, compiled, joints, files.missing)


def _compiled(root: Element, source: Path, files: MeshFiles) -> mujoco.MjModel:
    xml = ElementTree.tostring(root, encoding="unicode")
    try:
        try_compiling(xml, files.contents)
        return mujoco.MjSpec.from_string(xml, assets=files.contents).compile()
    except COMPILE_ERRORS as error:
        raise ModelFileError(source, f"{error}.") from error


def _refuse_guessed_inertia(model: mujoco.MjModel, source: Path, files: MeshFiles) -> None:
    """Refuse a mass that MuJoCo computed from a mesh that is not there."""
    for geom in range(model.ngeom):
        mesh = int(model.geom_dataid[geom])
        if Geom(int(model.geom_type[geom])) != Geom.mjGEOM_MESH or mesh < 0:
            continue
        name, body = model.mesh(mesh).name, model.body(int(model.geom_bodyid[geom]))
        if name in files.missing and not _has_inertial(source, body.name):
            why = files.missing[name]
            raise ModelFileError(
                source, f"the mass of body {body.name!r} would come from a mesh that cannot be read: {why}."
            )


def _has_inertial(source: Path, body: str) -> bool:
    return any(
        element.get("name", "") == body and element.find("inertial") is not None
        for element in read_tree(source).iter("body")
    )
