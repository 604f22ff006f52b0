"""Geometric tracking of the base with arm feed-forward and a momentum-based disturbance observer.

Position and attitude follow Lee, Leok & McClamroch, "Geometric tracking control of a quadrotor UAV on SE(3)" (CDC
2010). The wrench comes from inverse dynamics of base and arm together, so that the arm's weight and its moving centre
of mass are fed forward. A vehicle with tilted rotors uses its sideways force first and tilts only for the rest; an
under-actuated one has none and always tilts: one law for both.
"""

import math

from aerial_il.control import controller_state as layout
from aerial_il.control.dynamics import inverse_dynamics, put, row, vec
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import (
    add,
    clip,
    cross,
    from_columns,
    limit_norm,
    matmul_back,
    norm,
    rotate,
    rotate_back,
    scale,
    sub,
)


@kernel
def mat(numbers):
    """Nine numbers, row by row, as a matrix."""
    m = numbers
    return (m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8])


@kernel
def feed_arm_forward(vehicle, scratch, acc):
    """Let the arm's servos reckon with an acceleration of the base, world, m/s²; ``scratch``: see ``SCRATCH``.

    Returns:
        force (N) and torque (N m, about the base origin) that this takes, world frame.
    """
    pos, rot, omega = vec(scratch.base_pos, 0), mat(scratch.base_rot), vec(scratch.omega, 0)
    still, servo = (0.0, 0.0, 0.0), scratch.servo_torque
    return inverse_dynamics(
        vehicle, scratch.frames, pos, rot, omega, scratch.joint_vel, acc, still, scratch.rest, servo
    )


@kernel
def position_loop(gains, state, pos, vel, feed_forward):
    """Base acceleration (world, m/s²) that brings the base to its reference."""
    error = sub(vec(state, layout.BASE_POS), pos)
    error_rate = sub(vec(state, layout.BASE_VEL), vel)
    acc = add(feed_forward, add(scale(gains.position, error), scale(gains.velocity, error_rate)))
    return limit_norm(acc, gains.max_acceleration)


@kernel
def desired_attitude(force, yaw, lateral_limit, max_tilt):
    """Attitude that lets the vehicle exert a force.

    Args:
        force: wanted force on the vehicle, world frame, N.
        yaw: wanted heading, rad.
        lateral_limit: sideways force available without tilting, N.
        max_tilt: rad.

    Returns:
        Rotation, world from base.
    """
    sideways = math.sqrt(force[0] * force[0] + force[1] * force[1])
    excess = max(0.0, sideways - lateral_limit) / max(sideways, 1e-9)
    up = max(force[2], 1e-3)
    limit = math.tan(max_tilt) * up
    tilt = limit_norm((excess * force[0], excess * force[1], 0.0), limit)
    z = (tilt[0], tilt[1], up)
    z = scale(1.0 / norm(z), z)
    y = cross(z, (math.cos(yaw), math.sin(yaw), 0.0))
    y = scale(1.0 / norm(y), y)
    return from_columns(cross(y, z), y, z)


@kernel
def attitude_loop(gains, rot, omega_body, wanted, yaw_rate):
    """Angular acceleration (body frame, rad/s²) that turns ``rot`` into ``wanted`` (Lee 2010, eq. 10 and 11)."""
    d = matmul_back(wanted, rot)  # Rdᵀ R
    error = (0.5 * (d[7] - d[5]), 0.5 * (d[2] - d[6]), 0.5 * (d[3] - d[1]))
    rate_error = sub(omega_body, rotate_back(rot, (0.0, 0.0, yaw_rate)))
    alpha = add(scale(-gains.attitude, error), scale(-gains.rate, rate_error))
    return (clip(alpha[0], -60.0, 60.0), clip(alpha[1], -60.0, 60.0), clip(alpha[2], -20.0, 20.0))


@kernel
def rotor_wrench(vehicle, thrust, rot, com_lever):
    """Force (N) and torque about the centre of mass (N m) of the rotors' actual thrusts, world frame.

    Args:
        vehicle: the nominal model. thrust: (R,) N. rot: world from base.
        com_lever: centre of mass minus base origin, world frame, m.
    """
    force, torque = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(thrust.size):
        push = scale(thrust[i], row(vehicle.rotor_axis, i))
        force = add(force, push)
        torque = add(torque, cross(row(vehicle.rotor_pos, i), push))
        torque = add(torque, scale(vehicle.rotor_drag_ratio[i], push))
    force, torque = rotate(rot, force), rotate(rot, torque)
    return force, sub(torque, cross(com_lever, force))


@kernel
def hasten_rotors(vehicle, gains, thrust_now, thrust):
    """Command slow rotors beyond the thrust they shall have, so that it comes with ``gains.rotor_response``.

    A rotor follows ``T' = (u - T) / τ``; commanding ``u = T + (τ / τ') (wanted - T)`` makes that ``(wanted - T) / τ'``.

    Args:
        vehicle, gains: model and tuning. thrust_now: (R,) N. thrust: (R,) wanted, N; changed in place.
    """
    for i in range(thrust.size):
        step = thrust[i] - thrust_now[i]
        tau = vehicle.rotor_tau_up if step > 0.0 else vehicle.rotor_tau_down
        beyond = thrust_now[i] + max(1.0, tau / gains.rotor_response) * step
        thrust[i] = clip(beyond, vehicle.rotor_min[i], vehicle.rotor_max[i])


@kernel
def observe_disturbance(state, linear, angular, force, torque, bandwidth, force_limit, torque_limit, dt):
    """Advance the generalised-momentum observer (De Luca & Mattone 2003): first order, ``bandwidth`` in 1/s.

    Args:
        state: controller state; the estimate is stored in it.
        linear, angular: momentum of the vehicle (kg m/s; about the centre of mass, kg m²/s), world frame.
        force, torque: known external wrench about the centre of mass, gravity included.
        force_limit, torque_limit: longest estimate, N and N m.
        dt: s.
    """
    gain = 1.0 - math.exp(-bandwidth * dt)
    _low_pass_residual(state, layout.FORCE, layout.LINEAR, linear, force, gain, force_limit, dt)
    _low_pass_residual(state, layout.TORQUE, layout.ANGULAR, angular, torque, gain, torque_limit, dt)


@kernel
def _low_pass_residual(state, estimate, last, momentum, known, gain, limit, dt):
    """Blend what the momentum's rate leaves unexplained into the estimate."""
    rate = scale(1.0 / dt, sub(momentum, vec(state, last)))
    old = vec(state, estimate)
    new = add(old, scale(gain, sub(sub(rate, known), old)))
    put(state, estimate, limit_norm(new, limit))
    put(state, last, momentum)
