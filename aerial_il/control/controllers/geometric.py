"""Geometric tracking on SE(3), with the arm fed forward; see ``control.flight`` for its parts and their sources."""

from dataclasses import dataclass
from typing import ClassVar

from aerial_il.control import controller_state as layout
from aerial_il.control.controllers.law import Law
from aerial_il.control.dynamics import put, rotational_inertia, vec
from aerial_il.control.flight import attitude_loop, desired_attitude, feed_arm_forward, mat, position_loop
from aerial_il.control.standing import keep_posture, let_go
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import add, cross, rotate, rotate_back, scale, sub


@dataclass(frozen=True)
class Geometric(Law):
    """Lee, Leok & McClamroch (CDC 2010)."""

    summary: ClassVar[str] = "geometric tracking on SE(3), arm fed forward, without an observer"


@kernel
def steer(own, vehicle, gains, scratch, state):
    """The wrench that gives base and arm the commanded accelerations, less the estimated disturbance."""
    pos, vel, rot = vec(scratch.base_pos, 0), vec(scratch.base_vel, 0), mat(scratch.base_rot)
    acc = position_loop(gains, state, pos, vel, vec(scratch.feed_forward, 0))
    force, torque = feed_arm_forward(vehicle, scratch, scale(vehicle.base_mobility, acc))
    disturbance = vec(state, layout.FORCE)
    torque = sub(sub(torque, vec(state, layout.TORQUE)), cross(vec(scratch.lever, 0), disturbance))
    force = sub(force, disturbance)
    wanted = desired_attitude(force, state[layout.BASE_YAW], vehicle.lateral_limit, gains.max_tilt)
    alpha = attitude_loop(gains, rot, vec(scratch.rate, 0), wanted, state[layout.BASE_YAW_RATE])
    torque = add(torque, rotational_inertia(vehicle, scratch.frames, pos, rot, rotate(rot, alpha)))
    borne = let_go(state, pos, vel, scratch.dt)
    if borne > 0.0:
        force, torque = scale(1.0 - borne, force), scale(1.0 - borne, torque)
        keep_posture(vehicle, scratch, state, borne)
    if borne == 1.0:
        put(state, layout.FORCE, (0.0, 0.0, 0.0))
        put(state, layout.TORQUE, (0.0, 0.0, 0.0))
    put(scratch.force, 0, rotate_back(rot, force))
    put(scratch.torque, 0, rotate_back(rot, torque))
