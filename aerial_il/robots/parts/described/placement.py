"""Poses of a model file's bodies in the frame of the vehicle's base."""

from __future__ import annotations

from collections.abc import Iterable

import mujoco
import numpy as np

from aerial_il.robots.parts.arm import Vector
from aerial_il.robots.parts.described.inertia import RigidBody
from aerial_il.robots.parts.described.model import Model
from aerial_il.robots.parts.described.shape import Shape, shape_of


class Placement:
    """Turns the file's world into the base's frame.

    Args:
        model: the file's. data: its state. base: body that is bolted to the vehicle.
        mount: (3,) where that body's origin sits on the vehicle's base, m. rot: (3, 3) how it is turned there.
    """

    def __init__(self, model: Model, data: mujoco.MjData, base: int, mount: np.ndarray, rot: np.ndarray) -> None:
        self.model, self.data = model, data
        self._turn = rot @ data.xmat[base].reshape(3, 3).T
        self._from, self._to = data.xpos[base].copy(), mount

    def point(self, point: np.ndarray) -> np.ndarray:
        """A point (3,) of the file's world, m."""
        return self._to + self._turn @ (point - self._from)

    def direction(self, direction: np.ndarray) -> np.ndarray:
        """A direction (3,) of the file's world."""
        return self._turn @ direction

    def axes(self, matrix: np.ndarray) -> np.ndarray:
        """A rotation (9,) of the file's world, as (3, 3)."""
        return self._turn @ matrix.reshape(3, 3)

    def rigid_body(self, body: int) -> RigidBody:
        """Mass and inertia of one body."""
        own = self.model.rigid_body(self.data, body)
        return RigidBody(own.mass, self.point(own.com), self._turn @ own.tensor @ self._turn.T)

    def massive(self, bodies: Iterable[int]) -> list[RigidBody]:
        """Mass and inertia of those of several bodies that have any."""
        return [body for body in map(self.rigid_body, bodies) if body.mass > 0.0]

    def shapes(self, bodies: Iterable[int], origin: np.ndarray) -> tuple[Shape, ...]:
        """Shapes of several bodies, about a point (3,) of the base's frame, m."""
        data, model = self.data, self.model
        return tuple(
            shape_of(
                model.compiled,
                geom,
                self.point(data.geom_xpos[geom]) - origin,
                self.axes(data.geom_xmat[geom]),
                coarse=model.coarse,
            )
            for body in bodies
            for geom in model.geoms_of(body)
        )


def turned_about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation (3, 3) about a unit axis by ``angle`` rad: Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def from_rpy(rpy: Vector) -> np.ndarray:
    """Rotation (3, 3) of roll, pitch and yaw (rad) about the fixed axes x, y and z, in this order, as URDF has it."""
    x, y, z = np.eye(3)
    return turned_about(z, rpy[2]) @ turned_about(y, rpy[1]) @ turned_about(x, rpy[0])
