"""Links and arms with the inertia and the shapes of a file, in the place of those that we draw ourselves."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco

from aerial_il.robots.parts.arm import Arm, Colour, Link, Vector
from aerial_il.robots.parts.described.shape import Shape


@dataclass(frozen=True)
class DescribedLink(Link):
    """A link with the inertia and the shapes of a file.

    Attributes:
        centre: of mass, m, tensor: (ixx, iyy, izz, ixy, ixz, iyz) about it, kg m², both in the frame of the link.
        shapes: what it collides with and looks like; without any, a capsule.
    """

    centre: Vector
    tensor: tuple[float, ...]
    shapes: tuple[Shape, ...] = ()

    @property
    def com(self) -> Vector:
        return self.centre

    @property
    def inertia(self) -> Vector:
        """Moments about the axes of the link: what the controller knows, while the simulated link has products too."""
        xx, yy, zz, *_ = self.tensor
        return (xx, yy, zz)

    def add_inertia(self, body: mujoco.MjsBody) -> None:
        if any(self.tensor[3:]):
            body.mass, body.ipos, body.fullinertia, body.explicitinertial = self.mass, self.centre, self.tensor, True
        else:  # along the link's own axes, which MuJoCo then keeps
            super().add_inertia(body)

    def add_shapes(self, spec: mujoco.MjSpec, body: mujoco.MjsBody, i: int, colour: Colour) -> None:
        if not self.shapes:
            super().add_shapes(spec, body, i, colour)
        for k, shape in enumerate(self.shapes):
            shape.add_to(spec, body, f"link_{i}_{k}")


@dataclass(frozen=True)
class DescribedArm(Arm):
    """An arm whose foot, what stays with the base, has shapes too."""

    foot: tuple[Shape, ...] = ()

    def add_to(self, spec: mujoco.MjSpec, base: mujoco.MjsBody) -> mujoco.MjsBody:
        for k, shape in enumerate(self.foot):
            shape.add_to(spec, base, f"foot_{k}")
        return super().add_to(spec, base)
