"""The nominal model of a cell, as disturbances look at it that change models from episode to episode."""

from __future__ import annotations

from functools import cached_property

import mujoco
import numpy as np

from aerial_il.robots.robot import Robot

# Fields that are no part of MuJoCo's model.
ROTOR_GAIN = "rotor_gain"  # (R,) what rotors give of their thrust
CAMERA_OFFSET = "camera_offset"  # (C, 3) how far the robot's cameras are from where they should be, their frames, m
CAMERA_TURN = "camera_turn"  # (C, 3) rotation vectors by which they are turned, their frames, rad
LENS = "lens"  # (C, 5) gains of red, green and blue, blur as a share of the height, noise of 255
LIGHTS = "lights"  # (4, 3) of the camera's own light: ambient, diffuse; of the sun: diffuse, direction
SHAPES = "shapes"  # (k, SHAPES_SIZE) solids for eyes alone: kind, size (3), position (3), rotation (9), colour (3)
SHAPES_SIZE = 19
PAINT = ("geom_rgba", "geom_matid", "mat_texrepeat")  # of the scene with all that eyes see, which physics may lack
SEEN = frozenset((CAMERA_OFFSET, CAMERA_TURN, LENS, LIGHTS, SHAPES, *PAINT))  # what no physics depends on


class Nominal:
    """What moves in a scene, and with what.

    Args:
        model: nominal, compiled. robot: what flies in it. scene: the same with all that eyes see; None for ``model``.

    Attributes:
        base: index of the robot's base among the bodies.
    """

    def __init__(self, model: mujoco.MjModel, robot: Robot, scene: mujoco.MjModel | None = None) -> None:
        self.model, self.robot, self.base = model, robot, model.body("base").id
        self.scene = scene or model

    def field(self, name: str) -> np.ndarray:
        """Return a copy of the nominal values of a field that a disturbance varies."""
        if name == ROTOR_GAIN:
            return np.ones(self.robot.num_rotors)
        if name in (CAMERA_OFFSET, CAMERA_TURN):
            return np.zeros((len(self.robot.mounted_cameras), 3))
        if name == LENS:
            return np.tile([1.0, 1.0, 1.0, 0.0, 0.0], (len(self.robot.mounted_cameras), 1))
        if name == LIGHTS:
            head, sun = self.scene.vis.headlight, self.scene.light("sun")
            return np.array([head.ambient, head.diffuse, sun.diffuse, sun.dir])
        if name == SHAPES:
            return np.zeros((0, SHAPES_SIZE))
        return getattr(self.scene if name in PAINT else self.model, name).copy()

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
