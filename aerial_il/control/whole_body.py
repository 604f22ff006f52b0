"""From an end-effector pose to base and joint references, and from the base's actual pose to joint set-points.

Two solutions of the same differential inverse kinematics. The *reference* configuration (base position, yaw, joints)
follows the end-effector reference; the base and the rest posture share the motion, base tilt is taken as zero. The
*set-points* of the arm are solved from the base's ACTUAL pose, tilt included, so that the arm cancels what the base
is off by. That second step makes it more accurate in wind than any gain of the base's own loop.
"""

from aerial_il.control import controller_state as layout
from aerial_il.control.contact import feel_contact, give_way
from aerial_il.control.dynamics import forward_kinematics, put, tool_jacobian, tool_pose, vec
from aerial_il.control.inverse_kinematics import (
    freeze_at_limits,
    rest_posture,
    solve_in_joint_space,
    solve_in_task_space,
)
from aerial_il.control.reference import moved_tool, read_rotation, write_rotation, yaw_and_pitch
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import (
    add,
    clip,
    limit_norm,
    mat_from_yaw,
    matmul_back,
    norm,
    rotate,
    rotvec_from_mat,
    scale,
    sub,
    wrap_angle,
)

DAMPING = 0.01  # m, of the weighted rows
REST_RATE, REST_SPEED = 5.0, 0.5  # 1/s, rad/s: how the reference posture returns to the rest posture
ARM_REST_RATE = 0.5  # 1/s: how the set-points return to the reference posture
LONGEST_ERROR = 0.15  # m: the arm does not chase a reference the base has yet to reach
ORIENTATION_SHARE = 0.3  # m/rad: weight of the reference's orientation against its position
YAW_MOBILITY = 2.0  # rad per metre of base motion considered equally dear
POSTURE_STEPS, POSTURE_STEP = 60, 0.3  # of the search for a posture; rad
POSTURE_FOUND = 1e-6  # m and rad: where it may stop earlier
POSTURE_STUCK = 3e-4  # rad: joints that move less ...
POSTURE_MISSED = 0.02  # m or rad: ... with the tool off by more get no nearer


@kernel
def seat_references(vehicle, scratch, state, pos, rot, yaw, joints):
    """Place every reference at the current state, at rest: the start of an episode, or a change of pilot."""
    forward_kinematics(vehicle, pos, rot, joints, 0, scratch.frames)
    tool, tool_rot = tool_pose(vehicle, scratch.frames)
    for k in range(layout.CONTROLLER_STATE_SIZE):
        state[k] = 0.0
    put(state, layout.TOOL_POS, tool)
    put(state, layout.TARGET_POS, tool)
    write_rotation(state, layout.TARGET_ROT, tool_rot)
    write_rotation(state, layout.TOOL_ROT, tool_rot)
    put(state, layout.BASE_POS, pos)
    state[layout.BASE_YAW] = yaw
    for j in range(vehicle.num_joints):
        state[layout.JOINT_REF + j] = joints[j]
        state[layout.JOINT_CMD + j] = joints[j]
    state[layout.READY] = 1.0


@kernel
def plan_reference(vehicle, scratch, state, interval):
    """Choose the velocity of the reference base, and its joints, so that the tool's reference is met an interval later.

    Args:
        vehicle: the nominal model. scratch: working memory.
        state: controller state; the base's velocity and the joints of the reference are written.
        interval: s, until the next plan.
    """
    pos, yaw = vec(state, layout.BASE_POS), state[layout.BASE_YAW]
    target, _, target_rot = moved_tool(state, interval)
    _linearise(vehicle, scratch, pos, mat_from_yaw(yaw), state, layout.JOINT_REF, target, target_rot, ORIENTATION_SHARE)
    heading, pitch = yaw_and_pitch(target_rot)
    share, most = min(1.0, REST_RATE * interval), REST_SPEED * interval
    pull, mobility, step = scratch.pull, scratch.mobility, scratch.step
    for c in range(3):
        pull[c], mobility[c] = 0.0, vehicle.base_mobility
    pull[3] = clip(share * wrap_angle(heading - yaw), -most, most)
    mobility[3] = YAW_MOBILITY * vehicle.base_mobility
    rest_posture(vehicle, pitch, pull, 4)
    for j in range(vehicle.num_joints):
        pull[4 + j] = clip(share * (pull[4 + j] - state[layout.JOINT_REF + j]), -most, most)
    solve_in_task_space(scratch, 4 + vehicle.num_joints, DAMPING)
    if freeze_at_limits(vehicle, scratch, state, layout.JOINT_REF):
        solve_in_task_space(scratch, 4 + vehicle.num_joints, DAMPING)
    put(state, layout.BASE_VEL, scale(1.0 / interval, vec(step, 0)))
    state[layout.BASE_YAW_RATE] = step[3] / interval
    for j in range(vehicle.num_joints):
        moved = state[layout.JOINT_REF + j] + step[4 + j]
        state[layout.JOINT_REF + j] = clip(moved, vehicle.joint_low[j], vehicle.joint_high[j])


@kernel
def advance_base(state, dt):
    """Move the base reference on for ``dt`` seconds."""
    put(state, layout.BASE_POS, add(vec(state, layout.BASE_POS), scale(dt, vec(state, layout.BASE_VEL))))
    state[layout.BASE_YAW] = wrap_angle(state[layout.BASE_YAW] + dt * state[layout.BASE_YAW_RATE])


@kernel
def solve_arm(vehicle, gains, scratch, state, pos, rot, measured, dt):
    """Move the joint set-points so that the tool meets its reference from the base's actual pose, or gives way.

    Args:
        vehicle, gains: model and tuning.
        scratch: working memory; ``servo_vel`` (J,) is written: velocity of the set-points, rad/s.
        state: controller state; the set-points in it are advanced.
        pos, rot: measured base pose. measured: (J,) joint positions, rad.
        dt: s.
    """
    count = vehicle.num_joints
    if count == 0:
        return
    target, target_rot = vec(state, layout.TOOL_POS), read_rotation(state, layout.TOOL_ROT)
    _linearise(vehicle, scratch, pos, rot, state, layout.JOINT_CMD, target, target_rot, gains.orientation_weight)
    feel_contact(vehicle, scratch, state, measured, dt)
    put(scratch.error, 0, add(vec(scratch.error, 0), give_way(vehicle, state, pos)))
    for j in range(count):
        scratch.pull[4 + j] = ARM_REST_RATE * dt * (state[layout.JOINT_REF + j] - state[layout.JOINT_CMD + j])
    solve_in_joint_space(scratch, 4, count, DAMPING)
    if freeze_at_limits(vehicle, scratch, state, layout.JOINT_CMD):
        solve_in_joint_space(scratch, 4, count, DAMPING)
    for j in range(count):
        joint, reach = state[layout.JOINT_CMD + j], vehicle.joint_speed[j] * dt
        moved = clip(joint + clip(scratch.step[4 + j], -reach, reach), vehicle.joint_low[j], vehicle.joint_high[j])
        scratch.servo_vel[j] = (moved - joint) / dt
        state[layout.JOINT_CMD + j] = moved


@kernel
def solve_posture(vehicle, scratch, pos, rot, target, target_rot, joints):
    """Find joint positions that bring the tool to a pose from a base that stays where it is.

    Args:
        vehicle: the nominal model. scratch: working memory. pos, rot: base pose. target, target_rot: tool pose.
        joints: (J,) where to start from, rad; changed in place.

    Returns:
        Distance (m) and angle (rad) by which the tool misses.
    """
    for _ in range(POSTURE_STEPS):
        _linearise(vehicle, scratch, pos, rot, joints, 0, target, target_rot, ORIENTATION_SHARE)
        off, turned = norm(vec(scratch.error, 0)), norm(vec(scratch.error, 3))
        if off < POSTURE_FOUND and turned < POSTURE_FOUND:
            break
        for j in range(vehicle.num_joints):
            scratch.pull[4 + j] = 0.0
        solve_in_joint_space(scratch, 4, vehicle.num_joints, DAMPING)
        if freeze_at_limits(vehicle, scratch, joints, 0):
            solve_in_joint_space(scratch, 4, vehicle.num_joints, DAMPING)
        farthest = 0.0
        for j in range(vehicle.num_joints):
            moved = joints[j] + clip(scratch.step[4 + j], -POSTURE_STEP, POSTURE_STEP)
            moved = clip(moved, vehicle.joint_low[j], vehicle.joint_high[j])
            farthest, joints[j] = max(farthest, abs(moved - joints[j])), moved
        if farthest < POSTURE_STUCK and max(off, turned) > POSTURE_MISSED:
            break
    _linearise(vehicle, scratch, pos, rot, joints, 0, target, target_rot, ORIENTATION_SHARE)
    return norm(vec(scratch.error, 0)), norm(vec(scratch.error, 3))


@kernel
def find_posture(vehicle, workspace, pos, rot, target, target_rot, joints):
    """:func:`solve_posture` for callers in Python: ``vehicle`` and ``workspace`` are (1,) arrays, see ``alone``."""
    return solve_posture(vehicle[0], workspace[0], pos, rot, target, target_rot, joints)


@kernel
def _linearise(vehicle, scratch, pos, rot, joints, start, target, target_rot, orientation_weight):
    """Write the tool's error and Jacobian at a base pose and ``joints[start:]``, and the weights of their rows."""
    forward_kinematics(vehicle, pos, rot, joints, start, scratch.frames)
    tool, tool_rot = tool_pose(vehicle, scratch.frames)
    tool_jacobian(vehicle, scratch.frames, pos, scratch.jacobian)
    put(scratch.error, 0, limit_norm(sub(target, tool), LONGEST_ERROR))
    put(scratch.error, 3, rotate(tool_rot, rotvec_from_mat(matmul_back(tool_rot, target_rot))))
    for r in range(3):
        scratch.weight[r] = 1.0
        scratch.weight[3 + r] = orientation_weight
    for j in range(vehicle.num_joints):
        scratch.mobility[4 + j] = 1.0
