"""Geoms of a compiled scene as the boxes, cylinders and spheres that URDF and markers know."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from aerial_il.presentation.rerun.geometry import GROUND_HALF_M, SEEN_GROUPS, colour_of
from aerial_il.presentation.rerun.ros2.kinematics import Pose, shifted

BOX, CYLINDER, SPHERE = "box", "cylinder", "sphere"
SLICES = 7  # of a flattened ellipsoid
GROUND_M = 0.002  # thickness of the piece of a plane that is drawn
Geom = mujoco.mjtGeom


@dataclass(frozen=True, eq=False)
class Shape:
    """A solid in the frame of its body.

    Attributes:
        kind: ``box``, ``cylinder`` along z, or ``sphere``. size: (3,) whole extents, m.
        pose: in the body's frame. colour: (4,) red, green, blue and opacity, 0 to 1.
    """

    kind: str
    size: np.ndarray
    pose: Pose
    colour: np.ndarray


def shapes_of(model: mujoco.MjModel, body: int, *, seen: bool = True) -> Iterator[Shape]:
    """Yield what a body looks like, or, not ``seen``, what it collides with."""
    first = model.body_geomadr[body]
    for geom in range(first, first + model.body_geomnum[body]):
        colour = colour_of(model, geom) / 255
        if seen and (model.geom_group[geom] >= SEEN_GROUPS or not colour[3]):
            continue
        if not seen and not (model.geom_contype[geom] or model.geom_conaffinity[geom]):
            continue
        place = Pose.of(model.geom_pos[geom], model.geom_quat[geom])
        for kind, size, inner in _solids(model, geom):
            yield Shape(kind, np.asarray(size, float), place.then(inner), colour)


Solid = tuple[str, tuple[float, ...], Pose]  # of three extents
HERE = Pose(np.zeros(3), Rotation.identity())


def _solids(model: mujoco.MjModel, geom: int) -> Iterator[Solid]:
    """Yield kind, extents and pose in the geom's frame; URDF has no capsules: a cylinder with a sphere at each end."""
    kind, (x, y, z) = Geom(model.geom_type[geom]), model.geom_size[geom]
    match kind:
        case Geom.mjGEOM_BOX:
            yield BOX, (2 * x, 2 * y, 2 * z), HERE
        case Geom.mjGEOM_SPHERE:
            yield SPHERE, (2 * x,) * 3, HERE
        case Geom.mjGEOM_CYLINDER | Geom.mjGEOM_CAPSULE:
            yield CYLINDER, (2 * x, 2 * x, 2 * y), HERE
            for end in (-y, y) if kind == Geom.mjGEOM_CAPSULE else ():
                yield SPHERE, (2 * x,) * 3, shifted(np.array([0.0, 0.0, end]))
        case Geom.mjGEOM_ELLIPSOID:
            yield from _ellipsoid(x, y, z)
        case Geom.mjGEOM_PLANE:  # a flat piece of the ground, as large as the scene needs
            sides = [2 * (side if 0 < side < GROUND_HALF_M else GROUND_HALF_M) for side in (x, y)]
            yield BOX, (sides[0], sides[1], GROUND_M), shifted(np.array([0.0, 0.0, -GROUND_M / 2]))
        case _:  # a mesh or a height field: the box around it
            yield BOX, tuple(2 * model.geom_aabb[geom, 3:]), shifted(model.geom_aabb[geom, :3])


def _ellipsoid(*half: float) -> Iterator[Solid]:
    """Discs on its shortest axis, of the same volume as the slices that they stand for: URDF has no ellipsoids."""
    thin = int(np.argmin(half))
    wide = np.sqrt(np.prod(np.delete(half, thin)))
    upright = np.eye(3)[:, [(thin + 1) % 3, (thin + 2) % 3, thin]]
    turned, edges = Rotation.from_matrix(upright), np.linspace(-1.0, 1.0, SLICES + 1)
    for low, high in pairwise(edges):
        across = 2 * wide * np.sqrt(1 - (high**2 + high * low + low**2) / 3)  # mean of 1 - h^2 over the slice
        middle = upright[:, 2] * half[thin] * (low + high) / 2
        yield CYLINDER, (across, across, half[thin] * (high - low)), Pose(middle, turned)
