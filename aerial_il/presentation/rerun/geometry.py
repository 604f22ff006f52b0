"""The geoms of a compiled scene as rerun draws them, logged once, each in the frame of its body."""

import re

import mujoco
import numpy as np
import rerun as rr

from aerial_il.presentation.rerun import palette
from aerial_il.presentation.rerun.log import Log

GROUND_HALF_M = 2.0  # of the piece of an endless plane that is drawn
SEEN_GROUPS = 3  # MuJoCo's own viewers, too, show the geoms of groups 0 to 2
Geom = mujoco.mjtGeom


def path_of(model: mujoco.MjModel, robot: np.ndarray, body: int) -> str:
    """Return the entity of a body below its scene: ``fixed``, ``robot/NAME`` or ``props/NAME``."""
    if body == 0:
        return "fixed"
    return f"{'robot' if robot[body] else 'props'}/{plain(model.body(body).name or f'body_{body}')}"


def plain(name: str) -> str:
    """Return a name as one part of an entity path."""
    return re.sub(r"[^A-Za-z0-9_.-]", "_", name)


def log_geometry(log: Log, model: mujoco.MjModel, robot: np.ndarray) -> None:
    """Log every visible geom once, below the entity of its body."""
    for geom in range(model.ngeom):
        colour = colour_of(model, geom)
        if model.geom_group[geom] >= SEEN_GROUPS or not colour[3]:
            continue
        body = path_of(model, robot, int(model.geom_bodyid[geom]))
        log.static(f"{body}/{plain(model.geom(geom).name or f'geom_{geom}')}", shape_of(model, geom, colour))


def colour_of(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Return a geom's colour (4,) uint8: its material's, where it has one that does not draw a texture."""
    material = model.geom_matid[geom]
    rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    return np.round(255 * np.clip(rgba, 0.0, 1.0)).astype(np.uint8)


def shape_of(model: mujoco.MjModel, geom: int, colour: np.ndarray) -> rr.AsComponents:
    """Return what draws a geom, in its body's frame."""
    kind, size, pos, quat = (getattr(model, f"geom_{name}")[geom] for name in ("type", "size", "pos", "quat"))
    solid = {"quaternions": [np.roll(quat, -1)], "colors": [colour], "fill_mode": rr.components.FillMode.Solid}
    along_z = {"lengths": [2 * size[1]], "radii": [size[0]]}
    match Geom(kind):
        case Geom.mjGEOM_MESH | Geom.mjGEOM_SDF:
            return _mesh(model, geom, colour)
        case Geom.mjGEOM_PLANE:
            return _plane(model, geom)
        case Geom.mjGEOM_BOX:
            return rr.Boxes3D(half_sizes=[size], centers=[pos], **solid)
        case Geom.mjGEOM_ELLIPSOID:
            return rr.Ellipsoids3D(half_sizes=[size], centers=[pos], **solid)
        case Geom.mjGEOM_SPHERE:
            return rr.Ellipsoids3D(half_sizes=[np.full(3, size[0])], centers=[pos], **solid)
        case Geom.mjGEOM_CYLINDER:
            return rr.Cylinders3D(centers=[pos], **along_z, **solid)
        case Geom.mjGEOM_CAPSULE:  # which rerun draws from its lower end and MuJoCo from its middle
            low = _turned(pos, quat, np.array([0.0, 0.0, -size[1]]))
            return rr.Capsules3D(translations=[low], **along_z, **solid)
        case _:  # a height field: nothing of ours has one
            return rr.Boxes3D(half_sizes=[model.geom_aabb[geom, 3:]], centers=[pos], colors=[colour])


def _plane(model: mujoco.MjModel, geom: int) -> rr.AsComponents:
    """A flat piece of the ground, quietly coloured, as large as the scene needs."""
    half = np.array([size if 0 < size < GROUND_HALF_M else GROUND_HALF_M for size in model.geom_size[geom, :2]])
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * [*half, 0.0]
    return rr.Mesh3D(
        vertex_positions=_turned(model.geom_pos[geom], model.geom_quat[geom], corners),
        triangle_indices=[[0, 1, 2], [0, 2, 3]],
        albedo_factor=[*palette.GROUND, 255],
    )


def _mesh(model: mujoco.MjModel, geom: int, colour: np.ndarray) -> rr.AsComponents:
    """A mesh with a vertex for each corner of each face, as its normals are."""
    mesh = model.geom_dataid[geom]
    faces = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
    corners = model.mesh_vert[model.mesh_vertadr[mesh] + model.mesh_face[faces].reshape(-1)]
    normals = model.mesh_normal[model.mesh_normaladr[mesh] + model.mesh_facenormal[faces].reshape(-1)]
    return rr.Mesh3D(
        vertex_positions=_turned(model.geom_pos[geom], model.geom_quat[geom], corners),
        vertex_normals=_turned(np.zeros(3), model.geom_quat[geom], normals),
        triangle_indices=np.arange(len(corners)).reshape(-1, 3),
        albedo_factor=colour,
    )


def _turned(pos: np.ndarray, quat: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return points (..., 3) of a geom's frame in its body's."""
    mat = np.zeros(9)
    mujoco.mju_quat2Mat(mat, quat)
    return points @ mat.reshape(3, 3).T + pos
