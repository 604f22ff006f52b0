"""Payload: masses that the controller does not know, of objects and somewhere in the hub."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import mujoco
import numpy as np

from aerial_il.suite.disturbances.disturbance import Disturbance, Strength
from aerial_il.suite.disturbances.nominal import Nominal, factors


@dataclass(frozen=True)
class Payload(Disturbance):
    """Masses that the controller does not know.

    Attributes:
        object_mass: half width of the range of an object's mass, as a share of the nominal one.
        base_mass: largest additional mass somewhere in the hub, as a share of the vehicle's.
    """

    object_mass: float = 0.3
    base_mass: float = 0.05
    strength: ClassVar[Strength | None] = Strength(
        "of its mass, by which each object and the vehicle weigh more", 0.0, 0.5
    )
    varies: ClassVar[tuple[str, ...]] = ("body_mass", "body_inertia", "body_ipos", "body_iquat")

    @classmethod
    def of(cls, strength: float) -> Payload:
        return KnownPayload(share=strength)

    def vary(self, fields: dict[str, np.ndarray], nominal: Nominal, rng: np.random.Generator) -> dict[str, Any]:
        robot, hub = nominal.robot, np.array(nominal.robot.base.hub_size)
        extra = 0.0 if robot.fixed else rng.uniform(0.0, self.base_mass) * robot.vehicle.mass
        where = rng.uniform(-hub, hub)
        masses = factors(rng, self.object_mass, len(nominal.objects))
        for factor, bodies in zip(masses, nominal.objects, strict=True):
            fields["body_mass"][bodies] *= factor
            fields["body_inertia"][bodies] *= factor
        if extra:
            attach(fields, nominal.base, extra, where)
        return {"object_mass": masses, "base_mass": extra, "base_offset": tuple(where.tolist())}


@dataclass(frozen=True)
class KnownPayload(Payload):
    """Masses that are the same in every episode, in a place of the hub that is drawn for it.

    Attributes:
        object_mass, base_mass: not used. share: of its mass, by which each object and the vehicle weigh more.
    """

    object_mass: float = 0.0
    base_mass: float = 0.0
    share: float = 0.0

    def vary(self, fields: dict[str, np.ndarray], nominal: Nominal, rng: np.random.Generator) -> dict[str, Any]:
        for bodies in nominal.objects:
            fields["body_mass"][bodies] *= 1.0 + self.share
            fields["body_inertia"][bodies] *= 1.0 + self.share
        if nominal.robot.fixed or not self.share:
            return {}
        hub = np.array(nominal.robot.base.hub_size)
        where, extra = rng.uniform(-hub, hub), self.share * nominal.robot.vehicle.mass
        attach(fields, nominal.base, extra, where)
        return {"base_mass": extra, "base_offset": tuple(where.tolist())}


TIERS = {"hard": Payload()}


def attach(fields: dict[str, np.ndarray], body: int, mass: float, where: np.ndarray) -> None:
    """Fix a point mass (kg) at ``where`` (m, body frame) to a body: new mass, centre of mass and principal axes."""
    axes, quat = np.empty(9), fields["body_iquat"][body]
    mujoco.mju_quat2Mat(axes, quat)
    rot = axes.reshape(3, 3)
    nominal, lever = fields["body_mass"][body], where - fields["body_ipos"][body]
    reduced = nominal * mass / (nominal + mass)
    point = reduced * (lever @ lever * np.eye(3) - np.outer(lever, lever))
    tensor = rot @ np.diag(fields["body_inertia"][body]) @ rot.T + point
    mujoco.mju_eig3(fields["body_inertia"][body], axes, quat, tensor.ravel())
    fields["body_mass"][body] += mass
    fields["body_ipos"][body] += lever * (mass / (nominal + mass))
