"""Rigid-body dynamics of a floating base with a serial arm: kinematics, momentum, recursive Newton–Euler.

Everything is expressed in the world frame about the base origin (Featherstone, *Rigid Body Dynamics Algorithms*,
2008, ch. 5, with the spatial vectors written out). The state of a vehicle is the base pose (``pos``, ``rot`` = world
from base), the base twist (``vel`` world, ``omega`` world), and joint positions and velocities.
"""

from aerial_il.control.vehicle import GRAVITY
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import (
    add,
    cross,
    dot,
    mat_from_axis_angle,
    matmul,
    rotate,
    rotate_back,
    scale,
    sub,
)

# Columns of a row of ``frames`` (J + 1, 15): joint position, link rotation, joint axis; all in the world frame. The
# last row holds position and rotation of the tool.
POSITION, ROTATION, AXIS = 0, 3, 12


@kernel
def vec(array, start):
    """Read three consecutive numbers as a vector."""
    return (array[start], array[start + 1], array[start + 2])


@kernel
def put(array, start, value):
    """Write a vector into three consecutive numbers."""
    array[start], array[start + 1], array[start + 2] = value


@kernel
def row(array, j, start=0):
    """Read three consecutive numbers of row ``j`` as a vector; a slice ``array[j]`` would cost reference counting."""
    return (array[j, start], array[j, start + 1], array[j, start + 2])


@kernel
def put_row(array, j, start, value):
    """Write a vector into three consecutive numbers of row ``j``."""
    array[j, start], array[j, start + 1], array[j, start + 2] = value


@kernel
def total_mass(vehicle):
    """Mass of base and links, kg."""
    mass = vehicle.base_mass
    for j in range(vehicle.num_joints):
        mass += vehicle.link_mass[j]
    return mass


@kernel
def link_rotation(frames, j):
    """Rotation (world from link) stored in row ``j`` of ``frames``."""
    return (
        frames[j, 3], frames[j, 4], frames[j, 5], frames[j, 6], frames[j, 7], frames[j, 8], frames[j, 9],
        frames[j, 10], frames[j, 11],
    )  # fmt: skip


@kernel
def forward_kinematics(vehicle, pos, rot, joints, start, frames):
    """Place every link and the tool; a base without an arm is its own tool.

    Args:
        vehicle: the nominal model.
        pos, rot: base position (m) and rotation, world from base.
        joints: joint positions, rad, from index ``start`` on.
        frames: (J + 1, 15) written: joint position, link rotation, joint axis, world frame; last the tool.
    """
    for j in range(vehicle.num_joints):
        axis = row(vehicle.link_axis, j)
        pos = add(pos, rotate(rot, row(vehicle.link_offset, j)))
        put_row(frames, j, AXIS, rotate(rot, axis))
        rot = matmul(rot, mat_from_axis_angle(axis, joints[start + j]))
        _put_pose(frames, j, pos, rot)
    _put_pose(frames, vehicle.num_joints, add(pos, rotate(rot, vec(vehicle.tool_offset, 0))), rot)


@kernel
def _put_pose(frames, j, pos, rot):
    """Write position and rotation into row ``j`` of ``frames``."""
    put_row(frames, j, POSITION, pos)
    for k in range(9):
        frames[j, ROTATION + k] = rot[k]


@kernel
def tool_pose(vehicle, frames):
    """Tool position (m) and rotation (world from tool) for placed links."""
    return row(frames, vehicle.num_joints, POSITION), link_rotation(frames, vehicle.num_joints)


@kernel
def tool_jacobian(vehicle, frames, pos, jacobian):
    """Geometric Jacobian of the tool with respect to base translation, base yaw and joints.

    Args:
        vehicle: the nominal model.
        frames: (J + 1, 15) placed links and tool.
        pos: base position, m.
        jacobian: (6, 4 + J) written: rows linear and angular velocity (world), columns base x, y, z, yaw, joints.
    """
    tool, _ = tool_pose(vehicle, frames)
    for k in range(3):
        for c in range(4):
            jacobian[k, c] = 1.0 if k == c else 0.0
            jacobian[3 + k, c] = 0.0
    lever = sub(tool, pos)
    jacobian[0, 3], jacobian[1, 3], jacobian[5, 3] = -lever[1], lever[0], 1.0
    for j in range(vehicle.num_joints):
        axis = row(frames, j, AXIS)
        linear = cross(axis, sub(tool, row(frames, j, POSITION)))
        for k in range(3):
            jacobian[k, 4 + j] = linear[k]
            jacobian[3 + k, 4 + j] = axis[k]


@kernel
def momentum(vehicle, frames, pos, rot, vel, omega, joint_vel):
    """Total momentum of base and arm.

    Args:
        vehicle: the nominal model.
        frames: (J + 1, 15) placed links and tool.
        pos, rot: base pose. vel, omega: base twist, world frame. joint_vel: (J,) rad/s.

    Returns:
        linear: kg m/s; angular: about the common centre of mass, kg m²/s; com: its position, m; mass: kg.
    """
    linear = scale(vehicle.base_mass, vel)
    angular = _spin_momentum(vec(vehicle.base_inertia, 0), rot, omega)
    moment = (0.0, 0.0, 0.0)  # Σ m (p - pos)
    mass = vehicle.base_mass
    origin = pos
    link_vel = vel
    for j in range(vehicle.num_joints):
        joint, link = row(frames, j, POSITION), link_rotation(frames, j)
        link_vel = add(link_vel, cross(omega, sub(joint, pos)))
        pos = joint
        omega = add(omega, scale(joint_vel[j], row(frames, j, AXIS)))
        arm = rotate(link, row(vehicle.link_com, j))
        m = vehicle.link_mass[j]
        p = scale(m, add(link_vel, cross(omega, arm)))
        lever = sub(add(joint, arm), origin)
        linear = add(linear, p)
        angular = add(angular, add(cross(lever, p), _spin_momentum(row(vehicle.link_inertia, j), link, omega)))
        moment = add(moment, scale(m, lever))
        mass += m
    lever = scale(1.0 / mass, moment)
    return linear, sub(angular, cross(lever, linear)), add(origin, lever), mass


@kernel
def inverse_dynamics(vehicle, frames, pos, rot, omega, joint_vel, acc, alpha, joint_acc, torque):
    """Wrench on the base and joint torques that produce given accelerations against gravity.

    Args:
        vehicle: the nominal model.
        frames: (J + 1, 15) placed links and tool.
        pos, rot: base pose. omega: base angular velocity, world, rad/s. joint_vel: (J,) rad/s.
        acc: base linear acceleration, world, m/s². alpha: base angular acceleration, world, rad/s².
        joint_acc: (J,) rad/s².
        torque: (J,) written: joint torques, N m.

    Returns:
        force (N) and torque (N m) on the base, world frame, about the base origin.
    """
    acc = add(acc, (0.0, 0.0, GRAVITY))
    base_force = scale(vehicle.base_mass, acc)
    base_moment = _spin_torque(vec(vehicle.base_inertia, 0), rot, omega, alpha)
    origin = pos
    force, moment = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)  # of the links so far, about the origin
    for j in range(vehicle.num_joints):
        joint, link, axis = row(frames, j, POSITION), link_rotation(frames, j), row(frames, j, AXIS)
        torque[j] = -_about_axis(axis, sub(joint, origin), force, moment)
        acc = add(acc, _point_acceleration(omega, alpha, sub(joint, pos)))
        pos = joint
        spin = scale(joint_vel[j], axis)
        alpha = add(add(alpha, scale(joint_acc[j], axis)), cross(omega, spin))
        omega = add(omega, spin)
        arm = rotate(link, row(vehicle.link_com, j))
        push = scale(vehicle.link_mass[j], add(acc, _point_acceleration(omega, alpha, arm)))
        force = add(force, push)
        moment = add(moment, _spin_torque(row(vehicle.link_inertia, j), link, omega, alpha))
        moment = add(moment, cross(sub(add(joint, arm), origin), push))
    for j in range(vehicle.num_joints):  # a joint carries all links less those before it
        joint, axis = row(frames, j, POSITION), row(frames, j, AXIS)
        torque[j] += _about_axis(axis, sub(joint, origin), force, moment)
    return add(base_force, force), add(base_moment, moment)


@kernel
def _about_axis(axis, lever, force, moment):
    """Component along ``axis``, through a point at ``lever``, of a wrench about the origin."""
    return dot(axis, sub(moment, cross(lever, force)))


@kernel
def rotational_inertia(vehicle, frames, pos, rot, alpha):
    """Torque (N m) that the whole vehicle, joints locked, needs for angular acceleration ``alpha`` (both world)."""
    torque = _spin_momentum(vec(vehicle.base_inertia, 0), rot, alpha)
    for j in range(vehicle.num_joints):
        link = link_rotation(frames, j)
        lever = sub(add(row(frames, j, POSITION), rotate(link, row(vehicle.link_com, j))), pos)
        torque = add(torque, cross(lever, scale(vehicle.link_mass[j], cross(alpha, lever))))
        torque = add(torque, _spin_momentum(row(vehicle.link_inertia, j), link, alpha))
    return torque


@kernel
def _point_acceleration(omega, alpha, arm):
    return add(cross(alpha, arm), cross(omega, cross(omega, arm)))


@kernel
def _spin_momentum(inertia, rot, omega):
    """Angular momentum R I Rᵀ ω of a body about its own centre, I diagonal in the body frame."""
    local = rotate_back(rot, omega)
    return rotate(rot, (inertia[0] * local[0], inertia[1] * local[1], inertia[2] * local[2]))


@kernel
def _spin_torque(inertia, rot, omega, alpha):
    """Euler's equation: R I Rᵀ α + ω × R I Rᵀ ω."""
    return add(_spin_momentum(inertia, rot, alpha), cross(omega, _spin_momentum(inertia, rot, omega)))
