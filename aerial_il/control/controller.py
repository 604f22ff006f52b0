"""The low-level controller: one tick from a measured state and an action to rotor thrusts and servo set-points.

It runs at the physics rate (250 Hz) on one vehicle; :mod:`aerial_il.suite` loops it over worlds inside compiled code,
:class:`Controller` offers it to everyone else.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from aerial_il.control import controller_state as layout
from aerial_il.control import controllers
from aerial_il.control.actions import ActionLevel, action_spec
from aerial_il.control.allocation import allocate
from aerial_il.control.dynamics import (
    forward_kinematics,
    momentum,
    put,
    rotational_inertia,
    row,
    total_mass,
    vec,
)
from aerial_il.control.flight import (
    feed_arm_forward,
    hasten_rotors,
    observe_disturbance,
    rotor_wrench,
)
from aerial_il.control.reference import (
    advance_tool,
    displaced_target,
    observe_target_rate,
    steer_position,
    steer_rotation,
)
from aerial_il.control.scratch import make_scratch
from aerial_il.control.steering import STEERING, call_steer
from aerial_il.control.vehicle import GRAVITY, Gains, Vehicle, record_of
from aerial_il.control.whole_body import advance_base, plan_reference, seat_references, solve_arm
from aerial_il.core import registry
from aerial_il.core.addresses import numbers_at
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import (
    add,
    clip,
    cross,
    limit_norm,
    mat_from_quat,
    orthonormalise,
    rotate,
    rotate_back,
    scale,
    sub,
    wrap_angle,
)

EE_POSE, EE_DELTA, BASE_JOINT, VELOCITY, CTBR, ROTOR = (int(level) for level in ActionLevel)
LEASH = 0.3  # m: how far a velocity command may run ahead of the base
GRIP_RESPONSE = 10.0  # 1/s: how fast the observer takes the gripper for closed


@kernel
def receive_action(vehicle, gains, scratch, level, action, qpos, state, interval):
    """Take note of a new action; call once per action, before the ticks that fly it.

    Args:
        vehicle, gains: model and tuning. scratch: working memory. level: an :class:`ActionLevel`. action: (Da,).
        qpos: base position, base quaternion and joint positions, at least 7 + J numbers.
        state: (CONTROLLER_STATE_SIZE,) controller state. interval: seconds between actions.
    """
    if state[layout.READY] == 0.0:
        joints = qpos[7 : 7 + vehicle.num_joints]
        rot = mat_from_quat((qpos[3], qpos[4], qpos[5], qpos[6]))
        seat_references(vehicle, scratch, state, vec(qpos, 0), rot, math.atan2(rot[3], rot[0]), joints)
    if level <= EE_DELTA:
        if level == EE_POSE:
            target, target_rot = vec(action, 0), orthonormalise(vec(action, 3), vec(action, 6))
        else:
            target, target_rot = displaced_target(state, vec(action, 0), vec(action, 3))
        observe_target_rate(state, target, gains, interval)
        steer_position(state, target, gains)
        steer_rotation(state, target_rot, gains, interval)
        plan_reference(vehicle, scratch, state, interval)


@kernel
def tick(vehicle, gains, steering, scratch, level, action, qpos, qvel, thrust_now, state, dt, thrust, servo):
    """Compute rotor and servo commands for the next ``dt`` seconds.

    Args:
        vehicle, gains: nominal model and tuning. steering: record of ``STEERING``, the flight law's addresses.
        scratch: working memory. level: an :class:`ActionLevel` as an integer. action: (Da,).
        qpos: base position (m), base quaternion (w, x, y, z), joint positions (rad).
        qvel: base velocity (world, m/s), base angular velocity (body, rad/s), joint velocities (rad/s).
        thrust_now: (R,) measured rotor thrusts, N.
        state: (CONTROLLER_STATE_SIZE,) controller state, advanced.
        dt: s.
        thrust: (R,) written: commanded thrusts, N.
        servo: (J,) written: servo set-points, rad, shifted by the feed-forward torque over the servo's stiffness.
    """
    count = vehicle.num_joints
    pos, vel = vec(qpos, 0), vec(qvel, 0)
    rot = mat_from_quat((qpos[3], qpos[4], qpos[5], qpos[6]))
    omega_body = vec(qvel, 3)
    omega = rotate(rot, omega_body)
    joint_vel = qvel[6 : 6 + count]
    frames = scratch.frames
    joints = qpos[7 : 7 + count]
    feed_forward = _advance_references(vehicle, gains, scratch, level, action, pos, rot, joints, state, dt)
    forward_kinematics(vehicle, pos, rot, qpos, 7, frames)
    lever = _observe(vehicle, gains, action, frames, pos, rot, vel, omega, joint_vel, thrust_now, state, dt)
    put(scratch.base_pos, 0, pos)
    put(scratch.base_vel, 0, vel)
    put(scratch.rate, 0, omega_body)
    put(scratch.omega, 0, omega)
    for k in range(9):
        scratch.base_rot[k] = rot[k]
    for j in range(count):
        scratch.joint_vel[j] = joint_vel[j]
    if level <= VELOCITY:
        put(scratch.feed_forward, 0, feed_forward)
        put(scratch.lever, 0, lever)
        scratch.dt = dt
        call_steer(steering.steer, numbers_at(steering.own), vehicle, gains, scratch, state)
    else:
        _, torque = feed_arm_forward(vehicle, scratch, _thrust_acceleration(vehicle, rot, thrust_now))
        if level == CTBR:
            torque = sub(sub(torque, vec(state, layout.TORQUE)), cross(lever, vec(state, layout.FORCE)))
            alpha = scale(gains.rate, sub(vec(action, 1), omega_body))
            torque = add(torque, rotational_inertia(vehicle, frames, pos, rot, rotate(rot, alpha)))
            put(scratch.force, 0, (0.0, 0.0, action[0]))
            put(scratch.torque, 0, rotate_back(rot, torque))
    if level == ROTOR:
        for i in range(thrust.size):
            thrust[i] = clip(action[i], vehicle.rotor_min[i], vehicle.rotor_max[i])
    else:
        force = _limit_lateral(vec(scratch.force, 0), vehicle.lateral_limit)
        allocate(vehicle.mixer, vehicle.rotor_min, vehicle.rotor_max, force, vec(scratch.torque, 0), thrust)
        hasten_rotors(vehicle, gains, thrust_now, thrust)
    for j in range(count):
        wanted_torque = scratch.servo_torque[j] + vehicle.joint_damping[j] * scratch.servo_vel[j]
        servo[j] = state[layout.JOINT_CMD + j] + wanted_torque / vehicle.joint_stiffness[j]


@kernel
def _thrust_acceleration(vehicle, rot, thrust_now):
    """Acceleration (world, m/s²) that the rotors' actual thrusts and gravity give the vehicle."""
    force = (0.0, 0.0, 0.0)
    for i in range(thrust_now.size):
        force = add(force, scale(thrust_now[i], row(vehicle.rotor_axis, i)))
    return sub(scale(1.0 / total_mass(vehicle), rotate(rot, force)), (0.0, 0.0, GRAVITY))


@kernel
def _observe(vehicle, gains, action, frames, pos, rot, vel, omega, joint_vel, thrust_now, state, dt):
    """Update the disturbance estimate; return centre of mass minus base origin, world frame, m."""
    linear, angular, com, mass = momentum(vehicle, frames, pos, rot, vel, omega, joint_vel)
    lever = sub(com, pos)
    if state[layout.READY] == 1.0:  # first tick: no rate of momentum yet
        put(state, layout.LINEAR, linear)
        put(state, layout.ANGULAR, angular)
        state[layout.READY] = 2.0
        return lever
    closing = 1.0 - gripper_opening(vehicle, action)
    state[layout.CLOSED] += min(1.0, GRIP_RESPONSE * dt) * (closing - state[layout.CLOSED])
    bandwidth = gains.observer + state[layout.CLOSED] * (gains.observer_loaded - gains.observer)
    force, torque = rotor_wrench(vehicle, thrust_now, rot, lever)
    force = add(force, (0.0, 0.0, -GRAVITY * mass))
    limit = gains.observer_limit * mass * GRAVITY
    observe_disturbance(state, linear, angular, force, torque, bandwidth, limit, limit * gains.observer_lever, dt)
    return lever


@kernel
def _advance_references(vehicle, gains, scratch, level, action, pos, rot, joints, state, dt):
    """Move the base and joint references on; return the base acceleration to feed forward, m/s²."""
    count = vehicle.num_joints
    if level <= EE_DELTA:
        advance_tool(state, dt)
        advance_base(state, dt)
        solve_arm(vehicle, gains, scratch, state, pos, rot, joints, dt)
        return vec(state, layout.TOOL_ACC)
    first = vehicle.num_rotors if level == ROTOR else 4
    if vehicle.base_mobility == 0.0:
        first = 0
    elif level == VELOCITY:
        _integrate_base(state, vec(action, 0), action[3], pos, gains, dt)
    elif level == BASE_JOINT:
        _approach_base(state, vec(action, 0), action[3], gains, dt)
    for j in range(count):
        old = state[layout.JOINT_CMD + j]
        wanted = old + dt * action[first + j] if level == VELOCITY else action[first + j]
        reach = vehicle.joint_speed[j] * dt
        new = clip(clip(wanted, old - reach, old + reach), vehicle.joint_low[j], vehicle.joint_high[j])
        state[layout.JOINT_CMD + j] = new
        scratch.servo_vel[j] = (new - old) / dt
    return (0.0, 0.0, 0.0)


@kernel
def gripper_opening(vehicle, action):
    """Commanded opening of the gripper in [0, 1]; 1 for a vehicle without one."""
    return clip(action[action.size - 1], 0.0, 1.0) if vehicle.gripper_stroke > 0.0 else 1.0


@kernel
def _integrate_base(state, velocity, yaw_rate, pos, gains, dt):
    """Follow a velocity command, on a leash to the actual position."""
    old = vec(state, layout.BASE_VEL)
    change = limit_norm(sub(velocity, old), 2.0 * gains.reference_acceleration * dt)
    new = add(old, change)
    put(state, layout.BASE_VEL, new)
    ahead = limit_norm(sub(add(vec(state, layout.BASE_POS), scale(dt, new)), pos), LEASH)
    put(state, layout.BASE_POS, add(pos, ahead))
    state[layout.BASE_YAW] = wrap_angle(state[layout.BASE_YAW] + dt * yaw_rate)
    state[layout.BASE_YAW_RATE] = yaw_rate


@kernel
def _approach_base(state, target, yaw, gains, dt):
    """Move the base reference towards an absolute target at the reference speed."""
    step = limit_norm(sub(target, vec(state, layout.BASE_POS)), gains.reference_speed * dt)
    put(state, layout.BASE_POS, add(vec(state, layout.BASE_POS), step))
    put(state, layout.BASE_VEL, scale(1.0 / dt, step))
    turn = clip(wrap_angle(yaw - state[layout.BASE_YAW]), -gains.reference_turn * dt, gains.reference_turn * dt)
    state[layout.BASE_YAW] = wrap_angle(state[layout.BASE_YAW] + turn)
    state[layout.BASE_YAW_RATE] = turn / dt


@kernel
def _limit_lateral(force, limit):
    """Limit the sideways part of a body-frame force, N."""
    sideways = limit_norm((force[0], force[1], 0.0), limit)
    return (sideways[0], sideways[1], force[2])


class Steering:
    """A flight law for a vehicle, as :func:`tick` calls it.

    Attributes:
        record: (1,) of ``STEERING``: addresses, one of them of the law's numbers, which live as long as this.
    """

    def __init__(self, law: str, vehicle: Vehicle) -> None:
        self._own = registry.get("controller", law)().record(vehicle)
        self.record = np.array([(controllers.address(law, self._own), self._own.ctypes.data)], STEERING)


class Controller:
    """Fly one vehicle from measured states: the public face of the compiled controller.

    Args:
        vehicle: nominal model, e.g. ``aerial_il.robots.get("ua_quad_arm4").vehicle``.
        level: name of the action level.
        law: name of the flight law, e.g. ``pid``. gains: tuning, None for the law's own.
        dt: seconds between ticks.
        ticks_per_action: ticks between two new actions.

    Example:
        >>> controller = Controller(vehicle)
        >>> thrust, servo = controller.update(action, qpos, qvel, thrust_now)
    """

    def __init__(
        self, vehicle: Vehicle, *, level: str = "ee_pose", law: str = "geometric_observer",
        gains: Gains | None = None, dt: float = 0.004, ticks_per_action: int = 5,
    ) -> None:  # fmt: skip
        self.vehicle, self.law = vehicle, law
        self.gains = (gains or registry.get("controller", law)().gains).fitted(vehicle)
        self.level = ActionLevel.parse(level)
        self.spec = action_spec(self.level, vehicle)
        self.dt, self.ticks_per_action = dt, ticks_per_action
        self._record, self._tuning, self._scratch = vehicle.record, record_of(self.gains), make_scratch()
        self._steering = Steering(law, vehicle)
        self.reset()

    def reset(self) -> None:
        """Forget references and disturbance estimate; the next update seats them at the state it is given."""
        self.state = np.zeros(layout.CONTROLLER_STATE_SIZE)
        self._ticks = 0

    @property
    def disturbance(self) -> np.ndarray:
        """(6,) estimated disturbance force (N) and torque about the centre of mass (N m), world frame."""
        return np.concatenate(
            [self.state[layout.FORCE : layout.FORCE + 3], self.state[layout.TORQUE : layout.TORQUE + 3]]
        )

    def update(
        self, action: np.ndarray, qpos: np.ndarray, qvel: np.ndarray, thrust_now: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Compute one tick.

        Args:
            action: (Da,) in the units of ``self.spec``.
            qpos: (7 + J,) base position, quaternion (w, x, y, z), joints.
            qvel: (6 + J,) base velocity (world), angular velocity (body), joint velocities.
            thrust_now: (R,) measured rotor thrusts, N.

        Returns:
            Rotor thrusts (R,) in N and servo set-points (J,) in rad.

        Raises:
            InvalidValueError: one of them has the wrong size or is not finite.
        """
        joints, rotors = self.vehicle.num_joints, self.vehicle.num_rotors
        action = _numbers(f"{self.level.label} action", action, self.spec.size)
        qpos, qvel = _numbers("qpos", qpos, 7 + joints), _numbers("qvel", qvel, 6 + joints)
        thrust_now = _numbers("thrust_now", thrust_now, rotors)
        if self._ticks % self.ticks_per_action == 0:
            interval = self.dt * self.ticks_per_action
            receive_action(
                self._record, self._tuning, self._scratch, int(self.level), action, qpos, self.state, interval
            )
        self._ticks += 1
        thrust, servo = np.empty(rotors), np.empty(joints)
        tick(
            self._record, self._tuning, self._steering.record[0], self._scratch, int(self.level), action, qpos, qvel,
            thrust_now, self.state, self.dt, thrust, servo,
        )  # fmt: skip
        return thrust, servo


def _numbers(name: str, values: ArrayLike, size: int) -> np.ndarray:
    """Return (size,) numbers for compiled code, which checks no bounds."""
    numbers = np.ascontiguousarray(values, float)
    if numbers.shape != (size,) or not np.isfinite(numbers).all():
        raise InvalidValueError(f"{name} is {size} finite numbers, got {values!r}.")
    return numbers
