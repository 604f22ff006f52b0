"""Rotors of a scene: sites of the base along whose z axes they push, and how hard.

Until engine 3 they were actuators, their thrusts activations; since then both are numbers of an episode's memory, and
the flight loop pushes. A site's first user number is the rotor's drag torque per newton of thrust, m.
"""

from __future__ import annotations

import mujoco
import numpy as np

from aerial_il.control.allocation import wrench_matrix
from aerial_il.control.vehicle import MAX_ROTORS
from aerial_il.core.rotations import mat_from_quat
from aerial_il.suite.physics.episode_state import THRUST

NAME = "rotor_{}".format


def rotor_sites(model: mujoco.MjModel) -> list[int]:
    """Return the indices of the rotors' sites, in their order."""
    found = (mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, NAME(i)) for i in range(MAX_ROTORS))
    return [site for site in found if site >= 0]


def rotor_wrenches(model: mujoco.MjModel) -> np.ndarray:
    """Return (R, 6) force and torque about the base origin of each rotor per newton of thrust, base frame; as built."""
    sites = rotor_sites(model)
    axes = np.reshape([mat_from_quat(quat)[2::3] for quat in model.site_quat[sites]], (-1, 3))
    return wrench_matrix(model.site_pos[sites], axes, model.site_user[sites, :1].ravel()).T.copy()


def knows_thrusts(model: mujoco.MjModel) -> bool:
    """Whether states of a scene tell its rotors' thrusts."""
    return bool(model.na) or model.nuserdata >= THRUST.stop


def thrusts_of(data: mujoco.MjData) -> np.ndarray:
    """Return a view of the thrusts of all rotors, N, and of what follows."""
    return data.act if data.act.size else data.userdata[THRUST]


def drag_ratio(model: mujoco.MjModel, index: int, site: int) -> float:
    """Return the drag torque of a rotor about its axis per newton of thrust, m; 0 where the scene does not say."""
    return float(model.actuator_gear[index, 5] if model.na else model.site_user[site, :1].sum())
