"""The flying base: a hub, one boom and one disc per rotor, thrust and drag torque at the rotor's own site."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from aerial_il.robots.parts.base import Base
from aerial_il.robots.parts.collision import NOTHING, ROBOT

CARBON = [0.16, 0.17, 0.19, 1.0]
SHELL = [0.87, 0.88, 0.90, 1.0]
DISC_FRONT, DISC_REAR = [0.95, 0.55, 0.15, 0.35], [0.35, 0.45, 0.60, 0.35]


@dataclass(frozen=True, eq=False, kw_only=True)
class Rotorcraft(Base):
    """A rigid multirotor base."""

    hub_size: tuple[float, float, float] = (0.08, 0.06, 0.035)

    def _add_hub(self, spec: mujoco.MjSpec, body: mujoco.MjsBody) -> None:
        box, ellipsoid = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_ELLIPSOID
        body.add_geom(name="hub", type=box, size=self.hub_size, rgba=CARBON, mass=0, **ROBOT)
        x, y, z = self.hub_size
        shell = {"pos": [0, 0, z], "size": [0.9 * x, 0.9 * y, 0.8 * z], "rgba": SHELL, "mass": 0}
        body.add_geom(name="shell", type=ellipsoid, **shell, **NOTHING)

    def _add_rotor(self, body: mujoco.MjsBody, i: int) -> None:
        pos, axis = self.rotor_pos[i], self.rotor_axis[i]
        capsule, cylinder = mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER
        radius = 0.035 * np.linalg.norm(pos)
        boom = {"fromto": [0, 0, 0, *pos], "size": [radius, 0, 0], "rgba": CARBON, "mass": 0}
        body.add_geom(name=f"boom_{i}", type=capsule, **boom, **NOTHING)
        ends = [*(pos + 0.010 * axis), *(pos + 0.018 * axis)]
        rgba = DISC_FRONT if pos[0] > 0 else DISC_REAR
        disc = {"fromto": ends, "size": [self.rotor_radius, 0, 0], "rgba": rgba, "mass": 0}
        body.add_geom(name=f"disc_{i}", type=cylinder, **disc, **ROBOT)


def ring(
    count: int, radius: float, *, first_angle: float, height: float = 0.0, cant: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (count, 3) and thrust axes (count, 3) of rotors on a circle, canted alternately about their booms.

    Args:
        count: rotors. radius: m. first_angle: rad, of rotor 0 from +x. height: m. cant: rad.
    """
    angle = first_angle + 2.0 * np.pi * np.arange(count) / count
    zero, one = np.zeros(count), np.ones(count)
    pos = np.stack([radius * np.cos(angle), radius * np.sin(angle), height * one], axis=1)
    tangent = np.stack([-np.sin(angle), np.cos(angle), zero], axis=1)
    side = np.where(np.arange(count) % 2 == 0, 1.0, -1.0)[:, None]
    axis = np.cos(cant) * np.array([0.0, 0.0, 1.0]) + np.sin(cant) * side * tangent
    return pos, axis
