"""Model parameters that differ from episode to episode: masses, friction, rotor gains.

MuJoCo's state vector does not hold them. They are a pure function of (cell, tier, seed), the seed being part of the
state, so that whoever restores a state can derive them again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from aerial_il.core.seeding import episode_rng
from aerial_il.robots.robot import Robot
from aerial_il.suite.tiers import Tier

PAYLOAD_FIELDS = ("body_mass", "body_inertia", "body_ipos", "body_iquat")
FRICTION_FIELDS = ("geom_friction", "dof_frictionloss")
MOTOR_FIELDS = ("actuator_gainprm",)


@dataclass(frozen=True)
class Variation:
    """Differences of one episode's model from the nominal one.

    Attributes:
        object_mass: factor of the mass of each object that can move, in the order of the model.
        base_mass: additional mass on the base, kg. base_offset: where, from the base origin, m.
        contact_friction, joint_friction: factors of the friction of all contacts and of the fixtures' joints.
        rotor_gain: factor of each rotor's thrust.
    """

    object_mass: tuple[float, ...] = ()
    base_mass: float = 0.0
    base_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    contact_friction: float = 1.0
    joint_friction: float = 1.0
    rotor_gain: tuple[float, ...] = ()


class Varied:
    """The nominal model of a cell and what a tier varies of it.

    Args:
        model: nominal. robot: what flies. task_name: registry name. tier: what disturbs.
    """

    def __init__(self, model: mujoco.MjModel, robot: Robot, task_name: str, tier: Tier) -> None:
        self.robot, self.task_name, self.tier = robot, task_name, tier
        self._base = model.body("base").id
        own = _descendants(model, self._base)
        self._objects = _moving_groups(model, own)
        self._fixture_dofs = ~np.isin(model.dof_bodyid, own)
        self._flies = model.body_dofnum[self._base] == 6
        self._nominal = {name: getattr(model, name).copy() for name in self.fields}

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of the model's fields that differ from world to world."""
        tier = self.tier
        parts = ((tier.payload, PAYLOAD_FIELDS), (tier.friction, FRICTION_FIELDS), (tier.motors, MOTOR_FIELDS))
        return tuple(name for component, fields in parts if component for name in fields)

    def draw(self, seed: int) -> Variation:
        """Return the draw of the episode ``seed``; each component has a stream of its own."""
        drawn: dict[str, Any] = {}
        if payload := self.tier.payload:
            rng = self._rng("payload", seed)
            drawn["base_mass"] = rng.uniform(0.0, payload.base_mass) * self.robot.vehicle.mass if self._flies else 0.0
            hub = np.array(self.robot.base.hub_size)
            drawn["base_offset"] = tuple(rng.uniform(-hub, hub).tolist())
            drawn["object_mass"] = _factors(rng, payload.object_mass, len(self._objects))
        if friction := self.tier.friction:
            rng = self._rng("friction", seed)
            (drawn["contact_friction"],) = _factors(rng, friction.contact, 1)
            (drawn["joint_friction"],) = _factors(rng, friction.joint, 1)
        if motors := self.tier.motors:
            drawn["rotor_gain"] = _factors(self._rng("motors", seed), motors.gain, self.robot.num_rotors)
        return Variation(**drawn)

    def values(self, variation: Variation) -> dict[str, np.ndarray]:
        """Values of :attr:`fields` for one world."""
        found = {name: value.copy() for name, value in self._nominal.items()}
        if self.tier.payload:
            for factor, bodies in zip(variation.object_mass, self._objects, strict=True):
                found["body_mass"][bodies] *= factor
                found["body_inertia"][bodies] *= factor
            if variation.base_mass:
                _attach(found, self._base, variation.base_mass, np.array(variation.base_offset))
        if self.tier.friction:
            found["geom_friction"][:, :2] *= variation.contact_friction  # torsional friction is sliding in a patch
            found["dof_frictionloss"][self._fixture_dofs] *= variation.joint_friction
        if self.tier.motors:
            found["actuator_gainprm"][: self.robot.num_rotors, 0] *= variation.rotor_gain
        return found

    def _rng(self, component: str, seed: int) -> np.random.Generator:
        return episode_rng(self.robot.name, self.task_name, component, seed)


def _factors(rng: np.random.Generator, half_width: float, count: int) -> tuple[float, ...]:
    """Factors uniform within ``half_width`` of 1."""
    return tuple((1.0 + rng.uniform(-half_width, half_width, count)).tolist())


def _descendants(model: mujoco.MjModel, root: int) -> list[int]:
    """A body and all that hangs from it; bodies are sorted, parents first."""
    found = [root]
    for body in range(root + 1, model.nbody):
        if model.body_parentid[body] in found:
            found.append(body)
    return found


def _moving_groups(model: mujoco.MjModel, robot: list[int]) -> list[np.ndarray]:
    """Bodies that move as one, for each movable object of the task."""
    welds = [int(w) for w in np.unique(model.body_weldid) if model.body_dofnum[w] > 0 and w not in robot]
    return [np.flatnonzero(model.body_weldid == weld) for weld in welds]


def _attach(fields: dict[str, np.ndarray], body: int, mass: float, where: np.ndarray) -> None:
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
