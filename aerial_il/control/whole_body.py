"""From an end-effector pose to base and joint references, and from the base's actual pose to joint set-points.

Two solutions of the same differential inverse kinematics. The *reference* configuration (base position, yaw, joints)
follows the end-effector reference; the base and the rest posture share the motion, base tilt is taken as zero. The
*set-points* of the arm are solved from the base's ACTUAL pose, tilt included, so that the arm cancels what the base
is off by. That second step is worth more accuracy in wind than any gain of the base's own loop.
"""

from __future__ import annotations

import numpy as np

from aerial_il.control import memory as mem
from aerial_il.control.dynamics import FRAME_SIZE, forward_kinematics, put, tool_jacobian, tool_pose, vec
from aerial_il.control.inverse_kinematics import damped_least_squares, freeze_at_limits, rest_posture
from aerial_il.control.reference import read_rotation, yaw_and_pitch
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import (
    add,
    clip,
    limit_norm,
    mat_from_yaw,
    matmul_back,
    rotate,
    rotvec_from_mat,
    scale,
    sub,
    wrap_angle,
)

DAMPING = 0.01  # m, of the weighted rows
REST_PULL = 0.02  # share of the distance to the rest posture taken back per tick
LONGEST_ERROR = 0.15  # m: the arm does not chase a reference the base has yet to reach
YAW_MOBILITY = 2.0  # rad per metre of base motion considered equally dear


@kernel
def seat_references(vehicle, memory, pos, rot, yaw, joints):
    """Place every reference at the current state, at rest: the start of an episode, or a change of pilot."""
    frames = np.empty((joints.size, FRAME_SIZE))
    forward_kinematics(vehicle, pos, rot, joints, frames)
    tool, tool_rot = tool_pose(vehicle, frames)
    for k in range(mem.MEMORY_SIZE):
        memory[k] = 0.0
    put(memory, mem.TOOL_POS, tool)
    put(memory, mem.TARGET_POS, tool)
    for k in range(9):
        memory[mem.TOOL_ROT + k] = tool_rot[k]
    put(memory, mem.BASE_POS, pos)
    memory[mem.BASE_YAW] = yaw
    for j in range(joints.size):
        memory[mem.JOINT_REF + j] = joints[j]
        memory[mem.JOINT_CMD + j] = joints[j]
    memory[mem.READY] = 1.0


@kernel
def pose_error(tool, tool_rot, target, target_rot, error):
    """Write position (m) and rotation-vector (rad) error of a tool pose, world frame, into ``error`` (6,)."""
    put(error, 0, limit_norm(sub(target, tool), LONGEST_ERROR))
    put(error, 3, rotate(tool_rot, rotvec_from_mat(matmul_back(tool_rot, target_rot))))


@kernel
def _workspace(count):
    """Arrays for one solution: link frames, Jacobian, error, weights, mobility, rest pull, step."""
    size = 4 + count
    block = np.empty((11, size))
    frames = np.empty((count, FRAME_SIZE))
    block[7:] = 0.0
    error, weight = block[6, :6], block[7, :6]
    weight[:] = 1.0
    block[8] = 1.0
    return frames, block[:6], error, weight, block[8], block[9], block[10]


@kernel
def solve_reference(vehicle, gains, memory, dt):
    """Advance the reference configuration to the end-effector reference; keep its velocity for feed-forward."""
    joints = memory[mem.JOINT_REF : mem.JOINT_REF + vehicle.link_mass.size]
    count = joints.size
    frames, jacobian, error, weight, mobility, pull, step = _workspace(count)
    pos, yaw = vec(memory, mem.BASE_POS), memory[mem.BASE_YAW]
    target_rot = read_rotation(memory, mem.TOOL_ROT)
    forward_kinematics(vehicle, pos, mat_from_yaw(yaw), joints, frames)
    tool, tool_rot = tool_pose(vehicle, frames)
    tool_jacobian(vehicle, frames, pos, jacobian)
    pose_error(tool, tool_rot, vec(memory, mem.TOOL_POS), target_rot, error)
    weight[3:] = 0.3
    mobility[3] = YAW_MOBILITY
    heading, pitch = yaw_and_pitch(target_rot)
    rest_posture(vehicle, pitch, pull[4:])
    for j in range(count):
        pull[4 + j] = clip(REST_PULL * (pull[4 + j] - joints[j]), -0.5 * dt, 0.5 * dt)
    pull[3] = clip(REST_PULL * wrap_angle(heading - yaw), -0.5 * dt, 0.5 * dt)
    damped_least_squares(jacobian, error, weight, mobility, pull, DAMPING, step)
    if freeze_at_limits(joints, vehicle.joint_low, vehicle.joint_high, step, mobility, 4):
        damped_least_squares(jacobian, error, weight, mobility, pull, DAMPING, step)
    move = (step[0], step[1], step[2])
    put(memory, mem.BASE_POS, add(pos, move))
    put(memory, mem.BASE_VEL, scale(1.0 / dt, move))
    memory[mem.BASE_YAW] = wrap_angle(yaw + step[3])
    memory[mem.BASE_YAW_RATE] = step[3] / dt
    for j in range(count):
        joints[j] = clip(joints[j] + step[4 + j], vehicle.joint_low[j], vehicle.joint_high[j])


@kernel
def solve_arm(vehicle, gains, memory, pos, rot, dt, joint_vel_cmd):
    """Move the joint set-points so that the tool meets its reference from the base's actual pose.

    Args:
        vehicle, gains: model and tuning.
        memory: controller memory; the set-points in it are advanced.
        pos, rot: measured base pose.
        dt: s.
        joint_vel_cmd: (J,) written: velocity of the set-points, rad/s.
    """
    joints = memory[mem.JOINT_CMD : mem.JOINT_CMD + vehicle.link_mass.size]
    count = joints.size
    frames, jacobian, error, weight, mobility, pull, step = _workspace(count)
    mobility, pull, step = mobility[4:], pull[4:], step[4:]  # the base is where it is
    forward_kinematics(vehicle, pos, rot, joints, frames)
    tool, tool_rot = tool_pose(vehicle, frames)
    tool_jacobian(vehicle, frames, pos, jacobian)
    pose_error(tool, tool_rot, vec(memory, mem.TOOL_POS), read_rotation(memory, mem.TOOL_ROT), error)
    weight[3:] = gains.orientation_weight
    for j in range(count):
        pull[j] = 0.1 * REST_PULL * (memory[mem.JOINT_REF + j] - joints[j])
    damped_least_squares(jacobian[:, 4:], error, weight, mobility, pull, DAMPING, step)
    if freeze_at_limits(joints, vehicle.joint_low, vehicle.joint_high, step, mobility, 0):
        damped_least_squares(jacobian[:, 4:], error, weight, mobility, pull, DAMPING, step)
    for j in range(count):
        move = clip(step[j], -vehicle.joint_speed[j] * dt, vehicle.joint_speed[j] * dt)
        moved = clip(joints[j] + move, vehicle.joint_low[j], vehicle.joint_high[j])
        joint_vel_cmd[j] = (moved - joints[j]) / dt
        joints[j] = moved
