"""Shapes of a link: what it collides with and what it looks like, out of a compiled model, into the scene's."""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np

from aerial_il.robots.parts.collision import NOTHING, ROBOT
from aerial_il.robots.parts.described import hull

Geom = mujoco.mjtGeom
PRIMITIVES = (Geom.mjGEOM_SPHERE, Geom.mjGEOM_CAPSULE, Geom.mjGEOM_ELLIPSOID, Geom.mjGEOM_CYLINDER, Geom.mjGEOM_BOX)
LOOKS, HIDDEN = 1, 3  # groups: pictures show 0 to 2
GREY = (0.5, 0.5, 0.5, 1.0)  # MuJoCo's own colour of what has none
OURS = (0.55, 0.58, 0.62, 1.0)
CONVEX = 0.8  # share of the hull's volume from which a mesh counts as its hull


@dataclass(frozen=True, eq=False)
class Shape:
    """A primitive, or a mesh that collides as its convex hull.

    Attributes:
        kind: MuJoCo's type of geom. size: (3,) as MuJoCo has it; no matter for a mesh.
        pos: (3,) m, rot: (3, 3) in the frame of the link. rgba: colour.
        collides: with the world; otherwise it is looks alone. seen: in pictures.
        vertices: (V, 3) m, faces: (F, 3) indices, of a mesh, in the frame of the shape.
    """

    kind: mujoco.mjtGeom
    size: np.ndarray
    pos: np.ndarray
    rot: np.ndarray
    rgba: tuple[float, ...]
    collides: bool
    seen: bool = True
    vertices: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    faces: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), int))

    @property
    def filling(self) -> float:
        """Share of its convex hull that it fills."""
        return hull.share(self.vertices, self.faces) if len(self.vertices) else 1.0

    @property
    def half_extent(self) -> np.ndarray:
        """(3,) half sizes of a box about its middle that holds it, along the axes of the link, m."""
        a, b, c = self.size
        half = {
            Geom.mjGEOM_SPHERE: (a, a, a),
            Geom.mjGEOM_CAPSULE: (a, a, a + b),
            Geom.mjGEOM_CYLINDER: (a, a, b),
            Geom.mjGEOM_MESH: np.abs(self.vertices).max(axis=0, initial=0.0),
        }.get(self.kind, (a, b, c))
        return np.abs(self.rot) @ np.array(half)

    def add_to(self, spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str) -> None:
        """Add the shape to a body, without mass: that is the link's own."""
        quat = np.empty(4)
        mujoco.mju_mat2Quat(quat, np.ascontiguousarray(self.rot).ravel())
        look = {"pos": self.pos, "quat": quat, "rgba": self.rgba, "mass": 0, "group": LOOKS if self.seen else HIDDEN}
        touch = ROBOT if self.collides else NOTHING
        if not len(self.vertices):
            body.add_geom(name=name, type=self.kind, size=self.size, **look, **touch)
            return
        faces = self.faces.astype(np.int32).ravel()
        spec.add_mesh(name=name, uservert=self.vertices.astype(np.float32).ravel(), userface=faces)
        body.add_geom(name=name, type=Geom.mjGEOM_MESH, meshname=name, **look, **touch)


def shape_of(model: mujoco.MjModel, geom: int, pos: np.ndarray, rot: np.ndarray, *, coarse: bool) -> Shape:
    """Return a compiled geom as a shape at ``pos`` (3,) m and ``rot`` (3, 3) in the frame of its link.

    Args:
        coarse: a mesh of more than 256 points becomes a hull of so many.
    """
    kind = Geom(int(model.geom_type[geom]))
    vertices, faces = np.zeros((0, 3)), np.zeros((0, 3), int)
    if kind == Geom.mjGEOM_MESH:
        vertices, faces = _mesh(model, int(model.geom_dataid[geom]))
    if coarse and len(vertices) > hull.POINTS:
        vertices, faces = hull.of_few_points(vertices)
    material = int(model.geom_matid[geom])
    rgba = tuple(float(value) for value in (model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]))
    return Shape(
        kind=kind,
        size=model.geom_size[geom].copy(),
        pos=pos,
        rot=rot,
        rgba=OURS if np.allclose(rgba, GREY) else rgba,
        collides=collides(model, geom),
        vertices=vertices,
        faces=faces,
    )


def collides(model: mujoco.MjModel, geom: int) -> bool:
    """Whether a geom takes part in collisions: looks have neither of the two masks."""
    return bool(model.geom_contype[geom] or model.geom_conaffinity[geom])


def _mesh(model: mujoco.MjModel, mesh: int) -> tuple[np.ndarray, np.ndarray]:
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    face, faces = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    return model.mesh_vert[first : first + count].copy(), model.mesh_face[face : face + faces].copy()
