"""The vehicle as the one rigid body that textbook laws take it for: hovering, the arm hanging at rest."""

from typing import NamedTuple

import numpy as np

from aerial_il.control.vehicle import Vehicle
from aerial_il.core.rotations import mat_from_axis_angle


class HoverBody(NamedTuple):
    """Base and arm in one.

    Attributes:
        mass: kg. com: (3,) centre of mass in the base frame, m. inertia: (3, 3) about it, base axes, kg m².
    """

    mass: float
    com: np.ndarray
    inertia: np.ndarray


def hover_body(vehicle: Vehicle) -> HoverBody:
    """Weld the joints at the posture with the tool pointing straight down."""
    pos, rot = np.zeros(3), np.eye(3)
    masses, places, inertias = [vehicle.base_mass], [pos], [np.diag(vehicle.base_inertia)]
    for j in range(vehicle.num_joints):
        pos = pos + rot @ vehicle.link_offset[j]
        turn = mat_from_axis_angle(tuple(map(float, vehicle.link_axis[j])), float(vehicle.rest_down[j]))
        rot = rot @ np.reshape(turn, (3, 3))
        masses.append(float(vehicle.link_mass[j]))
        places.append(pos + rot @ vehicle.link_com[j])
        inertias.append(rot @ np.diag(vehicle.link_inertia[j]) @ rot.T)
    mass = sum(masses)
    com = np.average(places, axis=0, weights=masses)
    inertia = np.zeros((3, 3))
    for m, place, own in zip(masses, places, inertias, strict=True):
        arm = place - com
        inertia += own + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return HoverBody(mass, com, inertia)
