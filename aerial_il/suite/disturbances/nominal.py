"""The nominal model of a cell, as disturbances look at it that change models from episode to episode."""

from __future__ import annotations

from functools import cached_property

import mujoco
import numpy as np

from aerial_il.robots.robot import Robot

# Fields that are no part of MuJoCo's model.
ROTOR_GAIN = "rotor_gain"  # (R,) what rotors give of their thrust
CAMERA_OFFSET = "camera_offset"  # (C, 3) how far the robot's cameras are from where they should be, their frames, m


class Nominal:
    """What moves in a scene, and with what.

    Args:
        model: nominal, compiled. robot: what flies in it.

    Attributes:
        base: index of the robot's base among the bodies.
    """

    def __init__(self, model: mujoco.MjModel, robot: Robot) -> None:
        self.model, self.robot, self.base = model, robot, model.body("base").id

    def field(self, name: str) -> np.ndarray:
        """Return a copy of the nominal values of a field that a disturbance varies."""
        if name == ROTOR_GAIN:
            return np.ones(self.robot.num_rotors)
        if name == CAMERA_OFFSET:
            return np.zeros((len(self.robot.mounted_cameras), 3))
        return getattr(self.model, name).copy()

    @cached_property
    def objects(self) -> tuple[np.ndarray, ...]:
        """Indices of the bodies that move as one, of each movable object of the task, in the order of the model."""
        welds = np.unique(self.model.body_weldid)
        moving = [int(weld) for weld in welds if self.model.body_dofnum[weld] > 0 and weld not in self._own]
        return tuple(np.flatnonzero(self.model.body_weldid == weld) for weld in moving)

    @cached_property
    def fixture_dofs(self) -> np.ndarray:
        """(nv,) bool: degrees of freedom that are not the robot's."""
        return ~np.isin(self.model.dof_bodyid, self._own)

    @cached_property
    def _own(self) -> list[int]:
        """The base and all that hangs from it; bodies are sorted, parents first."""
        found = [self.base]
        for body in range(self.base + 1, self.model.nbody):
            if self.model.body_parentid[body] in found:
                found.append(body)
        return found


def factors(rng: np.random.Generator, half_width: float, count: int) -> tuple[float, ...]:
    """Return ``count`` factors uniform within ``half_width`` of 1."""
    return tuple((1.0 + rng.uniform(-half_width, half_width, count)).tolist())
