"""Propellers that turn as fast as their thrust asks for, drawn where they are while a shutter is open."""

from dataclasses import dataclass

import mujoco
import numpy as np

from aerial_il.presentation.studio.workshop import PREFIX
from aerial_il.suite.physics.rotors import drag_ratio, knows_thrusts, rotor_sites, thrusts_of

SHUTTER_S = 5e-4
THRUST_COEFFICIENT, AIR_DENSITY = 0.012, 1.225  # of hovering rotors: thrust / (ρ A (ω R)²); kg/m³


@dataclass(frozen=True)
class Propeller:
    """A propeller of a stage.

    Attributes:
        geom, site: numbers of its geom and site. index: of its rotor.
        radius: m. sense: +1 or -1, in which it turns about the thrust's axis.
    """

    geom: int
    site: int
    index: int
    radius: float
    sense: float

    def speed(self, data: mujoco.MjData) -> float:
        """Return how fast it turns, rad/s, by momentum theory's thrust coefficient."""
        disc = np.pi * self.radius**2
        tip = np.sqrt(max(0.0, float(thrusts_of(data)[self.index])) / (THRUST_COEFFICIENT * AIR_DENSITY * disc))
        return float(tip / self.radius)


def propellers(model: mujoco.MjModel) -> tuple[Propeller, ...]:
    """Return the propellers of a staged scene."""
    turning, known = [], knows_thrusts(model)
    for index, site in enumerate(rotor_sites(model)):
        geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, f"{PREFIX}_propeller_{index}")
        if geom >= 0 and known:
            sense = -float(np.sign(drag_ratio(model, index, site))) or 1.0
            turning.append(Propeller(geom, site, index, float(model.geom_aabb[geom, 3:].max()), sense))
    return tuple(turning)


def turn(data: mujoco.MjData, turning: tuple[Propeller, ...], still: np.ndarray, share: float) -> None:
    """Turn the propellers to where they are after ``share`` of the shutter's time.

    Args:
        data: of the stage, with its geoms in place. turning: its propellers. still: (G, 9) orientations of its geoms
            with propellers at rest. share: in [0, 1].
    """
    for propeller in turning:
        speed = propeller.speed(data)
        angle = propeller.sense * (speed * (data.time + share * SHUTTER_S) + propeller.index)
        quat, about = np.empty(4), np.empty(9)
        mujoco.mju_axisAngle2Quat(quat, data.site_xmat[propeller.site].reshape(3, 3)[:, 2].copy(), angle)
        mujoco.mju_quat2Mat(about, quat)
        data.geom_xmat[propeller.geom] = (about.reshape(3, 3) @ still[propeller.geom].reshape(3, 3)).ravel()
