"""Solids as triangles: rounded blocks, turned parts, tapered tubes, propellers. All are closed and face outwards."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import mujoco
import numpy as np

QUARTER = 3  # vertices along a quarter of a rounded edge
AROUND = 26  # vertices around a turned part
BLADE_SECTIONS, BLADE_POINTS = 8, 8


@dataclass(frozen=True, eq=False)
class Solid:
    """Triangles with a normal at each vertex.

    Attributes:
        points: (V, 3) m. normals: (V, 3) unit vectors. faces: (F, 3) indices, anticlockwise from outside.
    """

    points: np.ndarray
    normals: np.ndarray
    faces: np.ndarray

    def __add__(self, other: Solid) -> Solid:
        faces = np.concatenate([self.faces, other.faces + len(self.points)])
        points, normals = (
            np.concatenate(pair) for pair in ((self.points, other.points), (self.normals, other.normals))
        )
        return Solid(points, normals, faces)

    def turned(self, angle: float) -> Solid:
        """Return it turned about its z axis by ``angle`` rad."""
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        return Solid(self.points @ turn, self.normals @ turn, self.faces)

    def add_to(self, spec: mujoco.MjSpec, name: str) -> None:
        """Add it to a scene as the mesh ``name``."""
        mesh = spec.add_mesh(name=name)
        mesh.uservert, mesh.userface = self.points.ravel(), self.faces.ravel()
        mesh.usernormal = self.normals.ravel()
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL


def block(half: np.ndarray | tuple[float, float, float], rounding: float) -> Solid:
    """Return a box of ``half`` sizes (3,) whose edges are rounded by ``rounding``, m."""
    half = np.asarray(half, float)
    inner = half - min(rounding, 0.999 * float(half.min()))
    rise = np.linspace(0.0, 0.5 * np.pi, QUARTER)
    up = np.concatenate([rise - 0.5 * np.pi, rise])  # from the south pole to the north pole; the equator twice
    side = np.concatenate([rise + 0.5 * np.pi * quarter for quarter in range(4)])
    corner_z = np.repeat([-1.0, 1.0], QUARTER)
    corner_x, corner_y = np.repeat([1.0, -1.0, -1.0, 1.0], QUARTER), np.repeat([1.0, 1.0, -1.0, -1.0], QUARTER)
    ring = np.ones_like(up)[:, None]
    normals = np.stack([np.cos(up)[:, None] * np.cos(side), np.cos(up)[:, None] * np.sin(side),
                        np.sin(up)[:, None] * np.ones_like(side)], axis=-1)  # fmt: skip
    corners = np.stack([ring * corner_x, ring * corner_y, corner_z[:, None] * np.ones_like(side)], axis=-1)
    south, north = (np.tile([0.0, 0.0, z], (1, len(side), 1)) for z in (-half[2], half[2]))
    points = np.concatenate([south, corners * inner + normals * (half - inner), north])
    return _sheet(points, np.concatenate([normals[:1], normals, normals[-1:]]))


def turned(*profile: tuple[float, float]) -> Solid:
    """Return the solid that a profile of (radius, height) m sweeps about z, given from the bottom to the top.

    Each stretch of the profile has its own normals, so that its corners stay sharp.
    """
    rings, slopes = [], []
    for (r0, z0), (r1, z1) in pairwise(profile):
        out = np.array([z1 - z0, r0 - r1])
        out /= max(float(np.hypot(*out)), 1e-12)
        rings += [(r0, z0), (r1, z1)]
        slopes += [out, out]
    angle = np.linspace(0.0, 2.0 * np.pi, AROUND + 1)
    c, s = np.cos(angle), np.sin(angle)
    r, z = np.array(rings).T[:, :, None]
    n, up = np.array(slopes).T[:, :, None]
    points = np.stack([r * c, r * s, z * np.ones_like(c)], axis=-1)
    return _sheet(points, np.stack([n * c, n * s, up * np.ones_like(c)], axis=-1))


def disc(radius: float, half_height: float, bevel: float) -> Solid:
    """Return an upright cylinder about the origin whose edges are bevelled, m."""
    b = min(bevel, 0.45 * half_height, 0.45 * radius)
    h, r = half_height, radius
    return turned((0, -h), (r - b, -h), (r, -h + b), (r, h - b), (r - b, h), (0, h))


def propeller(radius: float, blades: int, clockwise: float) -> Solid:
    """Return twisted blades in the plane z = 0 about the z axis, m."""
    one = _blade(radius, -1.0 if clockwise else 1.0)
    angles = 2.0 * np.pi * np.arange(blades) / blades
    whole = one.turned(angles[0])
    for angle in angles[1:]:
        whole += one.turned(float(angle))
    return whole


def _blade(radius: float, sense: float) -> Solid:
    """One blade along x: widest at a third, its pitch falling towards a rounded tip."""
    share = np.linspace(0.07, 1.0, BLADE_SECTIONS)
    chord = radius * np.interp(share, [0.07, 0.18, 0.38, 0.75, 0.93, 1.0], [0.07, 0.12, 0.19, 0.135, 0.09, 0.012])
    thick = radius * np.interp(share, [0.07, 0.3, 1.0], [0.035, 0.018, 0.004])
    pitch = sense * np.arctan(0.19 / np.maximum(share, 0.2))
    turn = 2.0 * np.pi * np.arange(BLADE_POINTS + 1) / BLADE_POINTS
    across, over = 0.5 * chord[:, None] * np.cos(turn), 0.5 * thick[:, None] * np.sin(turn)
    y = across * np.cos(pitch)[:, None] - over * np.sin(pitch)[:, None]
    z = across * np.sin(pitch)[:, None] + over * np.cos(pitch)[:, None]
    x = radius * share[:, None] * np.ones_like(y)
    n_across, n_over = np.cos(turn) / chord[:, None], np.sin(turn) / thick[:, None]
    ny = n_across * np.cos(pitch)[:, None] - n_over * np.sin(pitch)[:, None]
    nz = n_across * np.sin(pitch)[:, None] + n_over * np.cos(pitch)[:, None]
    normals = np.stack([np.zeros_like(ny), ny, nz], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    points = np.stack([x, y, z], axis=-1)
    return _sheet(points, normals)


def tube(length: float, radii: tuple[float, float, float]) -> Solid:
    """Return a tube along z from 0 to ``length`` m, its radius given at the bottom, the middle and the top, m."""
    below, waist, above = radii
    sides = ((below, 0.0), (waist, 0.22 * length), (waist, 0.78 * length), (above, length))
    return turned((0.0, 0.0), *sides, (0.0, length))


def _sheet(points: np.ndarray, normals: np.ndarray) -> Solid:
    """Join a grid (M, N, 3) of points, rows going up and columns anticlockwise, by triangles."""
    m, n = points.shape[:2]
    index = np.arange(m * n).reshape(m, n)
    index = np.concatenate([index, index[:, :1]], axis=1)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    flat = points.reshape(-1, 3)
    size = np.linalg.norm(
        np.cross(flat[faces[:, 1]] - flat[faces[:, 0]], flat[faces[:, 2]] - flat[faces[:, 0]]), axis=1
    )
    return Solid(flat, normals.reshape(-1, 3), faces[size > 1e-14])
