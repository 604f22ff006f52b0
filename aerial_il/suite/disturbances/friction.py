"""Friction: of contacts and of the joints of fixtures, that is not the nominal one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from aerial_il.suite.disturbances.disturbance import Disturbance, Strength
from aerial_il.suite.disturbances.nominal import Nominal, factors


@dataclass(frozen=True)
class Friction(Disturbance):
    """Friction that is not the nominal one.

    Attributes:
        contact: half width of the range of all contacts' sliding friction, as a share of the nominal one.
        joint: the same for the dry friction of hinges and slides of fixtures.
    """

    contact: float = 0.3
    joint: float = 0.3
    strength: ClassVar[Strength | None] = Strength("times the nominal friction, of contacts and fixtures", 0.1, 3.0)
    varies: ClassVar[tuple[str, ...]] = ("geom_friction", "dof_frictionloss")

    @classmethod
    def of(cls, strength: float) -> Friction:
        return KnownFriction(factor=strength)

    def vary(self, fields: dict[str, np.ndarray], nominal: Nominal, rng: np.random.Generator) -> dict[str, Any]:
        (contact,), (joint,) = factors(rng, self.contact, 1), factors(rng, self.joint, 1)
        fields["geom_friction"][:, :2] *= contact  # torsional friction is sliding in a patch
        fields["dof_frictionloss"][nominal.fixture_dofs] *= joint
        return {"contact_friction": contact, "joint_friction": joint}


@dataclass(frozen=True)
class KnownFriction(Friction):
    """Friction that is the same in every episode.

    Attributes:
        factor: of all contacts' sliding friction, and of the dry friction of hinges and slides of fixtures.
    """

    contact: float = 0.0
    joint: float = 0.0
    factor: float = 1.0

    def vary(self, fields: dict[str, np.ndarray], nominal: Nominal, rng: np.random.Generator) -> dict[str, Any]:
        fields["geom_friction"][:, :2] *= self.factor
        fields["dof_frictionloss"][nominal.fixture_dofs] *= self.factor
        return {"contact_friction": self.factor, "joint_friction": self.factor}


TIERS = {"hard": Friction()}
