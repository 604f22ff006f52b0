"""The flying base: a hub, one boom and one disc per rotor, thrust and drag torque at the rotor's own site."""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np

from aerial_il.robots.parts.collision import NOTHING, ROBOT

CARBON = [0.16, 0.17, 0.19, 1.0]
SHELL = [0.87, 0.88, 0.90, 1.0]
DISC_FRONT, DISC_REAR = [0.95, 0.55, 0.15, 0.35], [0.35, 0.45, 0.60, 0.35]


@dataclass(frozen=True, eq=False)
class Rotorcraft:
    """A rigid multirotor base.

    Attributes:
        mass: kg. inertia: diagonal about the origin, kg m².
        rotor_pos: (R, 3) m. rotor_axis: (R, 3) unit thrust directions. rotor_spin: (R,) +1 where the drag torque on
            the base acts along the thrust axis, -1 against it.
        rotor_radius: m. max_thrust: N per rotor. drag_ratio: m, torque over thrust.
        tau_up, tau_down: s, thrust time constants.
        drag: linear body drag along x, y, z, N s/m.
        hub_size: half sizes of the hub, m.
    """

    mass: float
    inertia: tuple[float, float, float]
    rotor_pos: np.ndarray
    rotor_axis: np.ndarray
    rotor_spin: np.ndarray
    rotor_radius: float
    max_thrust: float
    drag_ratio: float
    tau_up: float
    tau_down: float
    drag: tuple[float, float, float]
    hub_size: tuple[float, float, float] = field(default=(0.08, 0.06, 0.035))

    @property
    def rotor_drag_ratio(self) -> np.ndarray:
        """(R,) signed torque about the thrust axis per newton, m."""
        return self.drag_ratio * self.rotor_spin

    def add_to(self, spec: mujoco.MjSpec) -> mujoco.MjsBody:
        """Add the base as a free body called ``base`` with actuators ``rotor_0`` … and return it."""
        body = spec.worldbody.add_body(
            name="base", mass=self.mass, ipos=[0, 0, 0], inertia=self.inertia, explicitinertial=True
        )
        body.add_freejoint(name="base")
        body.add_site(name="imu", size=[0.005] * 3, group=4)
        box, ellipsoid = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_ELLIPSOID
        body.add_geom(name="hub", type=box, size=self.hub_size, rgba=CARBON, mass=0, **ROBOT)
        x, y, z = self.hub_size
        shell = {"pos": [0, 0, z], "size": [0.9 * x, 0.9 * y, 0.8 * z], "rgba": SHELL, "mass": 0}
        body.add_geom(name="shell", type=ellipsoid, **shell, **NOTHING)
        for i in range(len(self.rotor_pos)):
            self._add_rotor(spec, body, i)
        return body

    def _add_rotor(self, spec: mujoco.MjSpec, body: mujoco.MjsBody, i: int) -> None:
        pos, axis = self.rotor_pos[i], self.rotor_axis[i]
        capsule, cylinder = mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER
        radius = 0.035 * np.linalg.norm(pos)
        boom = {"fromto": [0, 0, 0, *pos], "size": [radius, 0, 0], "rgba": CARBON, "mass": 0}
        body.add_geom(name=f"boom_{i}", type=capsule, **boom, **NOTHING)
        ends = [*(pos + 0.010 * axis), *(pos + 0.018 * axis)]
        rgba = DISC_FRONT if pos[0] > 0 else DISC_REAR
        disc = {"fromto": ends, "size": [self.rotor_radius, 0, 0], "rgba": rgba, "mass": 0}
        body.add_geom(name=f"disc_{i}", type=cylinder, **disc, **ROBOT)
        body.add_site(name=f"rotor_{i}", pos=pos, size=[0.004] * 3, group=4, quat=_quat_with_z_along(axis))
        motor = spec.add_actuator(name=f"rotor_{i}", target=f"rotor_{i}", trntype=mujoco.mjtTrn.mjTRN_SITE)
        motor.gear = [0, 0, 1, 0, 0, self.rotor_drag_ratio[i]]
        motor.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
        motor.dynprm[0] = self.tau_up
        motor.ctrllimited, motor.ctrlrange = True, [0.0, self.max_thrust]


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


def _quat_with_z_along(axis: np.ndarray) -> np.ndarray:
    quat = np.empty(4)
    mujoco.mju_quatZ2Vec(quat, np.asarray(axis, float))
    return quat
