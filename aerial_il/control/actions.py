"""The levels at which a vehicle can be commanded: one vocabulary for policies, experts and people.

========== ================================================================== ===========================
level      action vector                                                      units
========== ================================================================== ===========================
ee_pose    tool position (world), tool rot6d (world from tool), gripper       m, 1, 1
ee_delta   displacement and rotation vector of the target (in its own frame)  m, rad, 1
           per action, gripper
base_joint base position (world), yaw, joint positions, gripper               m, rad, rad, 1
velocity   base velocity (world), yaw rate, joint velocities, gripper         m/s, rad/s, rad/s, 1
ctbr       collective thrust, body rates, joint positions, gripper            N, rad/s, rad, 1
rotor      thrust of every rotor, joint positions, gripper                    N, rad, 1
========== ================================================================== ===========================

A fixed base has no part in ``base_joint`` and ``velocity``, and neither ``ctbr`` nor ``rotor``; a vehicle without a
gripper has no entry for it.

``ee_delta`` moves the pose commanded last, not the pose reached, so that a steady command is followed without drift;
the target stays within ``TARGET_LEAD`` of the end-effector reference. The bounds are those of a swift demonstration at
50 actions per second.

rot6d is the first two columns of the rotation matrix, stacked (Zhou et al. 2019). The gripper runs from 0 (closed) to 1
(open).
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from aerial_il.control.vehicle import GRAVITY, Vehicle
from aerial_il.core.errors import UnknownNameError
from aerial_il.core.specs import ActionSpec

WORKSPACE_LOW = np.array([-3.0, -3.0, 0.0])
WORKSPACE_HIGH = np.array([3.0, 3.0, 3.0])
MAX_SPEED, MAX_YAW_RATE = 1.5, 1.5
MAX_BODY_RATE = 6.0
MAX_DISPLACEMENT, MAX_TURN = 0.03, 0.1  # m and rad per action
TARGET_LEAD = 0.15  # m


class ActionLevel(IntEnum):
    """Levels of the control cascade at which an action may enter."""

    EE_POSE = 0
    EE_DELTA = 1
    BASE_JOINT = 2
    VELOCITY = 3
    CTBR = 4
    ROTOR = 5

    @property
    def label(self) -> str:
        """Name used in configurations, e.g. ``ee_pose``."""
        return self.name.lower()

    @staticmethod
    def parse(name: str) -> ActionLevel:
        """Return the level called ``name``.

        Raises:
            UnknownNameError: no level has that name.
        """
        for level in ActionLevel:
            if level.label == name:
                return level
        raise UnknownNameError("action level", name, [level.label for level in ActionLevel])


def levels_of(vehicle: Vehicle) -> tuple[ActionLevel, ...]:
    """Return the levels at which a vehicle can be commanded."""
    fixed = (ActionLevel.EE_POSE, ActionLevel.EE_DELTA, ActionLevel.BASE_JOINT, ActionLevel.VELOCITY)
    return tuple(ActionLevel) if vehicle.base_mobility else fixed


def check_level(level: ActionLevel, vehicle: Vehicle, name: str) -> None:
    """Refuse a level that the vehicle called ``name`` does not have.

    Raises:
        UnknownNameError: names the levels it has.
    """
    offered = levels_of(vehicle)
    if level not in offered:
        labels = [level.label for level in offered]
        raise UnknownNameError("action level", level.label, labels, f"{name} has no rotors: its base is fixed.")


def action_spec(level: ActionLevel, vehicle: Vehicle) -> ActionSpec:
    """Labels, units and bounds of an action level on a vehicle."""
    joints, rotors = len(vehicle.link_mass), len(vehicle.rotor_max)
    lift = float(vehicle.rotor_max @ vehicle.rotor_axis[:, 2])
    speed = vehicle.joint_speed
    parts: dict[ActionLevel, list[tuple[str, str, np.ndarray, np.ndarray]]] = {
        ActionLevel.EE_POSE: [
            ("ee_{xyz}", "m", WORKSPACE_LOW, WORKSPACE_HIGH),
            ("ee_rot6d_{0:6}", "", -np.ones(6), np.ones(6)),
        ],
        ActionLevel.EE_DELTA: [
            ("ee_delta_{xyz}", "m", -np.full(3, MAX_DISPLACEMENT), np.full(3, MAX_DISPLACEMENT)),
            ("ee_turn_{xyz}", "rad", -np.full(3, MAX_TURN), np.full(3, MAX_TURN)),
        ],
        ActionLevel.BASE_JOINT: [
            ("base_{xyz}", "m", WORKSPACE_LOW, WORKSPACE_HIGH),
            ("yaw", "rad", -np.full(1, np.pi), np.full(1, np.pi)),
            (f"joint_{{0:{joints}}}", "rad", vehicle.joint_low, vehicle.joint_high),
        ],
        ActionLevel.VELOCITY: [
            ("base_vel_{xyz}", "m/s", -np.full(3, MAX_SPEED), np.full(3, MAX_SPEED)),
            ("yaw_rate", "rad/s", -np.full(1, MAX_YAW_RATE), np.full(1, MAX_YAW_RATE)),
            (f"joint_vel_{{0:{joints}}}", "rad/s", -speed, speed),
        ],
        ActionLevel.CTBR: [
            ("thrust", "N", np.zeros(1), np.full(1, lift)),
            ("rate_{xyz}", "rad/s", -np.full(3, MAX_BODY_RATE), np.full(3, MAX_BODY_RATE)),
            (f"joint_{{0:{joints}}}", "rad", vehicle.joint_low, vehicle.joint_high),
        ],
        ActionLevel.ROTOR: [
            (f"rotor_{{0:{rotors}}}", "N", vehicle.rotor_min, vehicle.rotor_max),
            (f"joint_{{0:{joints}}}", "rad", vehicle.joint_low, vehicle.joint_high),
        ],
    }
    rows = parts[level]
    if not vehicle.base_mobility and level > ActionLevel.EE_DELTA:
        rows = rows[-1:]
    if vehicle.gripper_stroke:
        rows = [*rows, ("gripper", "", np.zeros(1), np.ones(1))]
    labels = [label for pattern, *_ in rows for label in _expand(pattern)]
    units = [unit for pattern, unit, *_ in rows for _ in _expand(pattern)]
    low = np.concatenate([low for *_, low, _ in rows])
    high = np.concatenate([high for *_, high in rows])
    return ActionSpec(level.label, tuple(labels), tuple(units), low, high)


def hover_action(
    level: ActionLevel,
    vehicle: Vehicle,
    tool_pos: np.ndarray,
    tool_rot6d: np.ndarray,
    *,
    base_pos: np.ndarray | None = None,
    yaw: float = 0.0,
) -> np.ndarray:
    """An action that keeps the vehicle where it is, at rest, gripper open.

    Args:
        level: action level. vehicle: nominal model.
        tool_pos: (3,) m, tool_rot6d: (6,) current tool pose; used by ``ee_pose`` alone.
        base_pos: (3,) m, yaw: rad, current base pose; used by ``base_joint`` alone, which needs it.

    Returns:
        (Da,) action; for levels below velocity it balances weight only at level attitude.
    """
    joints = len(vehicle.link_mass)
    weight = vehicle.mass * GRAVITY
    base, arm = {
        ActionLevel.EE_POSE: lambda: ([], [*tool_pos, *np.clip(tool_rot6d, -1.0, 1.0)]),
        ActionLevel.EE_DELTA: lambda: ([], np.zeros(6)),
        ActionLevel.BASE_JOINT: lambda: ([*np.asarray(base_pos), yaw], vehicle.rest_down),
        ActionLevel.VELOCITY: lambda: ([0.0] * 4, np.zeros(joints)),
        ActionLevel.CTBR: lambda: ([weight, 0.0, 0.0, 0.0], vehicle.rest_down),
        ActionLevel.ROTOR: lambda: (vehicle.mixer[:, 2] * weight, vehicle.rest_down),
    }[level]()
    return np.array([*(base if vehicle.base_mobility else []), *arm, *([1.0] if vehicle.gripper_stroke else [])])


def _expand(pattern: str) -> list[str]:
    """``a_{xyz}`` -> a_x a_y a_z; ``a_{0:2}`` -> a_0 a_1; anything else -> itself."""
    if "{" not in pattern:
        return [pattern]
    stem, inner = pattern.rstrip("}").split("{")
    keys = [str(i) for i in range(int(inner[2:]))] if ":" in inner else list(inner)
    return [stem + key for key in keys]
