"""A base that stands still: a column with an arm on top, as on a laboratory's floor."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from aerial_il.robots.parts.base import Base
from aerial_il.robots.parts.collision import NOTHING, ROBOT

STEEL, DARK = [0.62, 0.64, 0.67, 1.0], [0.25, 0.26, 0.28, 1.0]
FLANGE_M = 0.012


@dataclass(frozen=True, eq=False, kw_only=True)
class Pedestal(Base):
    """A column at ``place`` (x, y) m whose top, the base's origin, is ``height`` m above the floor."""

    place: tuple[float, float]
    height: float

    @property
    def fixed(self) -> bool:
        return True

    @property
    def pose(self) -> tuple[float, ...]:
        return (*self.place, self.height, 1.0, 0.0, 0.0, 0.0)

    def _add_hub(self, spec: mujoco.MjSpec, body: mujoco.MjsBody) -> None:
        cylinder, radius = mujoco.mjtGeom.mjGEOM_CYLINDER, self.hub_size[0]
        column = {"fromto": [0, 0, -self.height, 0, 0, -FLANGE_M], "size": [0.6 * radius, 0, 0], "rgba": STEEL}
        body.add_geom(name="hub", type=cylinder, mass=0, **column, **ROBOT)
        for name, bottom in (("flange", -FLANGE_M), ("sole", -self.height)):
            ends, size = [0, 0, bottom, 0, 0, bottom + FLANGE_M], [radius if name == "flange" else 1.6 * radius, 0, 0]
            body.add_geom(name=name, type=cylinder, fromto=ends, size=size, rgba=DARK, mass=0, **NOTHING)

    def _add_rotor(self, body: mujoco.MjsBody, i: int) -> None:
        raise NotImplementedError("a pedestal has no rotors")


def pedestal(*, place: tuple[float, float], height: float, radius: float, mass: float) -> Pedestal:
    """Return a column of ``radius`` m; ``mass`` kg counts as the robot's although the floor carries it."""
    spin = 0.5 * mass * radius**2
    return Pedestal(
        place=place,
        height=height,
        mass=mass,
        inertia=(spin, spin, spin),
        rotor_pos=np.zeros((0, 3)),
        rotor_axis=np.zeros((0, 3)),
        rotor_drag_ratio=np.zeros(0),
        max_thrust=0.0,
        tau_up=1e-3,
        tau_down=1e-3,
        rotor_radius=0.0,
        drag=(0.0, 0.0, 0.0),
        hub_size=(radius, radius, FLANGE_M),
    )
