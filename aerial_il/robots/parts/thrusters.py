"""A small body moved by six ideal thrusters: any wrench within bounds, at once, without air."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from aerial_il.robots.parts.base import Base
from aerial_il.robots.parts.collision import NOTHING, ROBOT

BODY, NOZZLE = [0.80, 0.83, 0.88, 1.0], [0.20, 0.50, 0.72, 1.0]
INSTANT_S = 1e-4  # far below a physics step


@dataclass(frozen=True, eq=False, kw_only=True)
class Thrusters(Base):
    """A sphere-like body; nozzles on its faces push either way, two along each axis."""

    def _add_hub(self, spec: mujoco.MjSpec, body: mujoco.MjsBody) -> None:
        ellipsoid = mujoco.mjtGeom.mjGEOM_ELLIPSOID
        body.add_geom(name="hub", type=ellipsoid, size=self.hub_size, rgba=BODY, mass=0, **ROBOT)

    def _add_rotor(self, body: mujoco.MjsBody, i: int) -> None:
        reach = 0.35 * float(min(self.hub_size)) * self.rotor_axis[i]
        ends = [*(self.rotor_pos[i] - reach), *(self.rotor_pos[i] + reach)]
        look = {"fromto": ends, "size": [0.3 * float(min(self.hub_size)), 0, 0], "rgba": NOZZLE, "mass": 0}
        body.add_geom(name=f"nozzle_{i}", type=mujoco.mjtGeom.mjGEOM_CYLINDER, **look, **NOTHING)


def thrusters(*, mass: float, radius: float, force: float) -> Thrusters:
    """Return a solid sphere of ``radius`` m whose thrusters push up to ``force`` N each.

    Six of them at unit directions: ±x push along y, ±y along z, ±z along x. Each axis has two, whose sum is a force
    along it and whose difference a torque about the next: the wrench matrix is invertible.
    """
    pos = radius * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
    axis = np.repeat(np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]], float), 2, axis=0)
    spin = 0.4 * mass * radius**2
    return Thrusters(
        mass=mass,
        inertia=(spin, spin, spin),
        rotor_pos=pos,
        rotor_axis=axis,
        rotor_drag_ratio=np.zeros(6),
        max_thrust=force,
        min_thrust=-force,
        tau_up=INSTANT_S,
        tau_down=INSTANT_S,
        rotor_radius=0.0,
        drag=(0.0, 0.0, 0.0),
        hub_size=(radius, radius, radius),
    )
