"""The end-effector reference: smooth, limited in speed and acceleration, without lag behind a steady motion.

A policy may command anything inside the action bounds, fifty times a second. The reference follows the command with a
second-order law whose speed and acceleration are limited; near the command its own rate is fed forward, so that a
target that moves steadily is tracked without delay, while a distant one is approached along a braking curve.
"""

import math

from aerial_il.control import controller_state as layout
from aerial_il.control.actions import TARGET_LEAD
from aerial_il.control.dynamics import put, vec
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import (
    add,
    column,
    limit_norm,
    mat_from_rotvec,
    matmul,
    matmul_back,
    norm,
    orthonormalise,
    rotate,
    rotvec_from_mat,
    scale,
    sub,
)

APPROACH = 4.0  # 1/s: speed wanted per metre of error
RESPONSE = 10.0  # 1/s: how fast the reference takes up the wanted speed
NEAR = 0.06  # m: a command's own rate counts only this close to it; farther off it may be a carrot held out ahead
TURN_APPROACH = 4.0  # 1/s: the same for orientation


@kernel
def read_rotation(state, start):
    """Read nine numbers as a rotation matrix."""
    return (
        state[start],
        state[start + 1],
        state[start + 2],
        state[start + 3],
        state[start + 4],
        state[start + 5],
        state[start + 6],
        state[start + 7],
        state[start + 8],
    )


@kernel
def write_rotation(state, start, rot):
    """Write a rotation matrix as nine numbers."""
    for k in range(9):
        state[start + k] = rot[k]


@kernel
def displaced_target(state, displacement, turn):
    """Move the target in its own frame; return its new position and rotation.

    Args:
        state: controller state; the target's rotation in it is advanced.
        displacement: m, turn: rotation vector, rad; both in the frame of the last target.
    """
    rot, tool = read_rotation(state, layout.TARGET_ROT), vec(state, layout.TOOL_POS)
    ahead = sub(add(vec(state, layout.TARGET_POS), rotate(rot, displacement)), tool)
    rot = matmul(rot, mat_from_rotvec(turn))
    rot = orthonormalise(column(rot, 0), column(rot, 1))
    write_rotation(state, layout.TARGET_ROT, rot)
    return add(tool, limit_norm(ahead, TARGET_LEAD)), rot


@kernel
def observe_target_rate(state, target, gains, interval):
    """Estimate how fast the commanded position moves; a jump counts as standing still.

    Call once per command. ``target``: position, world, m. ``interval``: seconds since the previous command.
    """
    rate = scale(1.0 / interval, sub(target, vec(state, layout.TARGET_POS)))
    if norm(rate) > 1.5 * gains.reference_speed:
        rate = (0.0, 0.0, 0.0)
    blended = add(scale(0.7, vec(state, layout.TARGET_VEL)), scale(0.3, rate))
    put(state, layout.TARGET_VEL, blended)
    put(state, layout.TARGET_POS, target)


@kernel
def steer_position(state, target, gains):
    """Choose the acceleration of the reference position towards ``target`` (world, m) until the next command."""
    error = sub(target, vec(state, layout.TOOL_POS))
    distance = norm(error)
    braking = math.sqrt(1.4 * gains.reference_acceleration * distance)
    speed = min(APPROACH * distance, min(braking, gains.reference_speed))
    near = max(0.0, 1.0 - (distance / NEAR) ** 2)
    wanted = add(scale(near, vec(state, layout.TARGET_VEL)), scale(speed / max(distance, 1e-9), error))
    wanted = limit_norm(wanted, gains.reference_speed)
    acc = limit_norm(scale(RESPONSE, sub(wanted, vec(state, layout.TOOL_VEL))), gains.reference_acceleration)
    put(state, layout.TOOL_ACC, acc)


@kernel
def steer_rotation(state, target, gains, interval):
    """Choose the angular velocity of the reference towards ``target`` (world from tool) for ``interval`` seconds."""
    rot = read_rotation(state, layout.TOOL_ROT)
    error = rotate(rot, rotvec_from_mat(matmul_back(rot, target)))
    wanted = limit_norm(scale(TURN_APPROACH, error), gains.reference_turn)
    omega = vec(state, layout.TOOL_OMEGA)
    put(state, layout.TOOL_OMEGA, add(omega, scale(min(1.0, RESPONSE * interval), sub(wanted, omega))))


@kernel
def moved_tool(state, dt):
    """Position, velocity and rotation of the reference ``dt`` seconds from now."""
    vel, acc = vec(state, layout.TOOL_VEL), vec(state, layout.TOOL_ACC)
    pos = add(vec(state, layout.TOOL_POS), add(scale(dt, vel), scale(0.5 * dt * dt, acc)))
    turn = mat_from_rotvec(scale(dt, vec(state, layout.TOOL_OMEGA)))
    rot = matmul(turn, read_rotation(state, layout.TOOL_ROT))
    return pos, add(vel, scale(dt, acc)), orthonormalise(column(rot, 0), column(rot, 1))


@kernel
def advance_tool(state, dt):
    """Move the end-effector reference on for ``dt`` seconds."""
    pos, vel, rot = moved_tool(state, dt)
    put(state, layout.TOOL_POS, pos)
    put(state, layout.TOOL_VEL, vel)
    write_rotation(state, layout.TOOL_ROT, rot)


@kernel
def yaw_and_pitch(rot):
    """Heading and downward pitch (rad) of a tool, defined for a tool that points straight down too.

    The heading is that of the tool's y axis less a quarter turn: it exists as long as the tool is not rolled on its
    side. ``rot``: world from tool.
    """
    y = column(rot, 1)
    yaw = math.atan2(-y[0], y[1])
    x = column(rot, 0)
    return yaw, math.atan2(-x[2], x[0] * math.cos(yaw) + x[1] * math.sin(yaw))
