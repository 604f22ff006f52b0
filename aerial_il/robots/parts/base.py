"""Flying bases that carry the arm: a rigid body, moved by thrusts that act at sites of their own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import mujoco
import numpy as np


@dataclass(frozen=True, eq=False, kw_only=True)
class Base(ABC):
    """A rigid base and the thrusts on it, SI units, in a frame that points forward, left and up.

    Attributes:
        mass: kg. inertia: diagonal about the origin, kg m².
        rotor_pos: (R, 3) m. rotor_axis: (R, 3) unit thrust directions. rotor_drag_ratio: (R,) torque on the base about
            the thrust axis per newton of thrust, signed, m.
        max_thrust, min_thrust: N, one number or (R,); below zero where a thrust can be reversed.
        tau_up, tau_down: s, thrust time constants.
        rotor_radius: m; 0 for thrusters that feel no ground.
        drag: linear body drag along x, y, z, N s/m.
        hub_size: half sizes of the hub, m.
    """

    mass: float
    inertia: tuple[float, float, float]
    rotor_pos: np.ndarray
    rotor_axis: np.ndarray
    rotor_drag_ratio: np.ndarray
    max_thrust: float | np.ndarray
    min_thrust: float | np.ndarray = 0.0
    tau_up: float
    tau_down: float
    rotor_radius: float
    drag: tuple[float, float, float]
    hub_size: tuple[float, float, float]

    @property
    def fixed(self) -> bool:
        """Whether the base stands still."""
        return False

    @property
    def pose(self) -> tuple[float, ...]:
        """Position (m) and quaternion (w, x, y, z) at which the base is put into a scene."""
        return (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)

    @property
    def num_rotors(self) -> int:
        return len(self.rotor_pos)

    @property
    def rotor_max(self) -> np.ndarray:
        """(R,) largest thrusts, N."""
        return np.full(self.num_rotors, self.max_thrust, float)

    @property
    def rotor_min(self) -> np.ndarray:
        """(R,) smallest thrusts, N."""
        return np.full(self.num_rotors, self.min_thrust, float)

    @property
    def span(self) -> float:
        """Diameter of the smallest upright cylinder about the origin that holds the base, m."""
        rotors = np.hypot(self.rotor_pos[:, 0], self.rotor_pos[:, 1]) + self.rotor_radius
        return 2.0 * float(np.max([np.hypot(*self.hub_size[:2]), *rotors]))

    def add_to(self, spec: mujoco.MjSpec) -> mujoco.MjsBody:
        """Add the base as a body called ``base``, free unless fixed, with actuators ``rotor_0`` …; return it."""
        body = spec.worldbody.add_body(
            name="base", pos=self.pose[:3], quat=self.pose[3:], mass=self.mass, ipos=[0, 0, 0], inertia=self.inertia,
            explicitinertial=True, simple=False,
        )  # fmt: skip
        if not self.fixed:
            body.add_freejoint(name="base")
        body.add_site(name="imu", size=[0.005] * 3, group=4)
        self._add_hub(spec, body)
        for i in range(self.num_rotors):
            self._add_rotor(body, i)
            self._add_motor(spec, body, i)
        return body

    @abstractmethod
    def _add_hub(self, spec: mujoco.MjSpec, body: mujoco.MjsBody) -> None:
        """Add the geoms of the body's middle."""

    @abstractmethod
    def _add_rotor(self, body: mujoco.MjsBody, i: int) -> None:
        """Add the geoms of one rotor."""

    def _add_motor(self, spec: mujoco.MjSpec, body: mujoco.MjsBody, i: int) -> None:
        quat = np.empty(4)
        mujoco.mju_quatZ2Vec(quat, np.asarray(self.rotor_axis[i], float))
        drag_ratio = float(self.rotor_drag_ratio[i])
        body.add_site(
            name=f"rotor_{i}", pos=self.rotor_pos[i], size=[0.004] * 3, group=4, quat=quat, userdata=[drag_ratio]
        )
        motor = spec.add_actuator(name=f"rotor_{i}", target=f"rotor_{i}", trntype=mujoco.mjtTrn.mjTRN_SITE)
        motor.gear = [0, 0, 1, 0, 0, drag_ratio]
        motor.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
        motor.dynprm[0] = self.tau_up
        motor.ctrllimited, motor.ctrlrange = True, [self.rotor_min[i], self.rotor_max[i]]
