"""Estimates that a policy is shown in place of the truth: poses with the bias, noise and delay of a real robot.

Two estimates make up an observation. The robot knows itself by the state estimate that its controller flies on
(``suite.physics.sensing``): one error of the base's pose moves base and tool as one, since encoders are exact.
It sees objects, each with a pose error that moves all of the object as one, and later than they are. A constant error
of the robot's own position is the same as a shift of all that it sees, for it flies, is commanded and counts in the
frame of its estimate: it is therefore an error of what is seen (``frame_bias``). What a user gives, such as a pose to
reach, is exact.

The slow errors and what has been seen but not yet shown live in the simulator's memory; biases are a pure function of
the episode's seed. Reward, success and experts stay with the truth.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from aerial_il.control.dynamics import put, vec
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import add, mat_from_quat, mat_from_rotvec, matmul, rotate, scale, sub
from aerial_il.suite.physics import episode_state as layout
from aerial_il.suite.physics.hooks import act_all, note, now_at
from aerial_il.suite.physics.native import doubles, mju_copy, mju_mat2quat
from aerial_il.suite.physics.noise import gaussian
from aerial_il.suite.physics.sensing import measure
from aerial_il.suite.physics.world import (
    MAX_NAMES,
    base_mat,
    base_pos,
    joint_pos,
    joint_vel,
    mocap_pos,
    record_at,
    site_mat,
    site_pos,
    tool_mat,
    tool_pos,
)
from aerial_il.suite.timing import CONTROL_DT_S

EXACT = -1  # in the place of an object: commanded, not seen
STILL = -1  # in the place of a slot: it does not move
NOT_SEEN, HINGE, SLIDE = range(3)  # kinds of joints

SIGHT = np.dtype(
    [
        *(
            (name, np.float64)
            for name in ("frame_bias", "position_bias", "position_noise", "angle_bias", "angle_noise")
        ),
        *((name, np.float64) for name in ("time", "force_bias", "force_noise")),
        *((name, np.int64) for name in ("lag", "num_objects", "num_sites", "num_joints", "num_mocaps", "num_forces")),
        *((name, np.int64) for name in ("own_qpos", "own_qvel")),  # numbers of the robot, which come first
        *((name, np.int64) for name in ("memory", "errors", "past", "past_size")),  # numbers, and where the sight's are
        ("centres", np.int64, (MAX_NAMES,)),  # the site of each object about which its error turns it
        *((name, np.int64, (MAX_NAMES,)) for name in ("site_objects", "site_slots", "mocap_objects")),
        *((name, np.int64, (MAX_NAMES,)) for name in ("joint_kinds", "joint_objects", "joint_slots")),
        ("num_velocities", np.int64),
        *((name, np.int64, (MAX_NAMES,)) for name in ("velocity_states", "velocity_objects", "velocity_slots")),
    ],
    align=True,
)
FORCES_START, TASK_START, OWN_MEMORY_STOP = layout.FORCES.start, layout.TASK.start, layout.TASK.stop
SEED, TICK, STEP, USERDATA_SIZE = layout.SEED, layout.TICK, layout.STEP, layout.USERDATA_SIZE
FRAME, OBJECT, KICK = 32, 36, 48  # first channels of random numbers: of the frame, of objects, of their noise
FORCE_BIAS, FORCE_NOISE = 80, 84
ABOUT_Z, ALONG_Z = 5, 2  # of an object's six errors, those that a hinge and a slide share


class Perception(NamedTuple):
    """Perception settings, the same for all worlds.

    Attributes:
        active: 0 where the truth is shown; then the rest does not matter.
        sight: (1,) record of :data:`SIGHT`. vehicle: (1,) record, as the controller has it.
        hooks: (1,) of the tier's disturbances.
    """

    active: int
    sight: np.ndarray
    vehicle: np.ndarray
    hooks: np.ndarray


@kernel
def begin_sight(perception, records, record_size, active):
    """Let the worlds in ``active`` (n,) bool have looked for ever as they do now."""
    sight = perception.sight[0]
    for i in range(active.size):
        if active[i]:
            world = record_at(records + i * record_size)
            for slot in range(sight.lag):
                _remember(sight, world, _memory(sight, world), sight.past + slot * sight.past_size)


@kernel
def advance_sight(perception, world, dt):
    """Look once more, at the beginning of a control step of ``dt`` s, and let the errors wander.

    Args:
        perception: see above. world: record of the truth; its memory is written.
    """
    sight = perception.sight[0]
    userdata = _memory(sight, world)
    if sight.lag > 0:
        _remember(sight, world, userdata, _past(sight, userdata))
    decay = math.exp(-dt / sight.time)
    kick = math.sqrt(1.0 - decay * decay)
    for k in range(6 * sight.num_objects):
        fresh = gaussian(userdata[SEED], userdata[TICK], KICK + k)
        userdata[sight.errors + k] = decay * userdata[sight.errors + k] + kick * fresh


@kernel
def perceive(perception, world, seen, now, effects):
    """Write what is seen of a world.

    Args:
        perception: see above. world: record of the truth. seen: record whose addresses are those of what is written;
            what cannot be seen stays NaN there. now, effects: addresses of this world's, see ``physics.hooks``.
    """
    sight = perception.sight[0]
    userdata = _memory(sight, world)
    _feel_forces(sight, world, seen)
    _estimate_robot(perception, world, seen, now, effects)
    for k in range(sight.num_sites):
        pos, mat = _seen_pose(sight, world, userdata, k)
        if sight.site_objects[k] != EXACT:
            pos, mat = _mistaken(sight, world, userdata, sight.site_objects[k], pos, mat)
        _write_site(seen, k, pos, mat)
    for k in range(sight.num_mocaps):
        pos = vec(mocap_pos(world, k), 0)
        if sight.mocap_objects[k] != EXACT:
            pos, _ = _mistaken(sight, world, userdata, sight.mocap_objects[k], pos, base_mat(world))
        put(doubles(seen.mocap_pos + 24 * k, 3), 0, pos)
    for k in range(sight.num_joints):
        if sight.joint_kinds[k] != NOT_SEEN:
            _see_joint(sight, world, userdata, seen, k)
    for k in range(sight.num_velocities):
        _see_velocity(sight, userdata, seen, k)


@kernel
def _memory(sight, world):
    """All that an episode remembers."""
    return doubles(world.userdata, sight.memory)


@kernel
def _past(sight, userdata):
    """Slot of the oldest observation kept: it is shown next, and the present one takes its place."""
    return sight.past + int(userdata[STEP]) % sight.lag * sight.past_size


@kernel
def _remember(sight, world, userdata, start):
    """Write all that moves, as it is now, from ``userdata[start]`` on."""
    for k in range(sight.num_sites):
        if sight.site_slots[k] != STILL:
            slot = start + sight.site_slots[k]
            put(userdata, slot, site_pos(world, k))
            mju_mat2quat(userdata.ctypes.data + 8 * (slot + 3), world.site_xmat + 72 * world.sites[k])
    for k in range(sight.num_joints):
        if sight.joint_slots[k] != STILL:
            slot = start + sight.joint_slots[k]
            userdata[slot], userdata[slot + 1] = joint_pos(world, k), joint_vel(world, k)
    for k in range(sight.num_velocities):
        put(userdata, start + sight.velocity_slots[k], vec(userdata, TASK_START + sight.velocity_states[k]))


@kernel
def _seen_pose(sight, world, userdata, k):
    """True position and rotation of site ``k`` at the time at which it was looked at."""
    slot = sight.site_slots[k]
    if slot == STILL or sight.lag == 0:
        return site_pos(world, k), site_mat(world, k)
    slot += _past(sight, userdata)
    quat = (userdata[slot + 3], userdata[slot + 4], userdata[slot + 5], userdata[slot + 6])
    return vec(userdata, slot), mat_from_quat(quat)


@kernel
def _mistaken(sight, world, userdata, which, pos, mat):
    """Pose of a part of object ``which`` after the error of the whole: turned about its centre, then shifted."""
    centre, _ = _seen_pose(sight, world, userdata, sight.centres[which])
    turn = mat_from_rotvec(_errors(sight, userdata, which, 3))
    shift = add(_errors(sight, userdata, which, 0), _frame_error(sight, userdata))
    return add(add(centre, shift), rotate(turn, sub(pos, centre))), matmul(turn, mat)


@kernel
def _frame_error(sight, userdata):
    """Shift of all that is seen, m."""
    seed = userdata[SEED]
    x, y, z = gaussian(seed, 0, FRAME), gaussian(seed, 0, FRAME + 1), gaussian(seed, 0, FRAME + 2)
    return scale(sight.frame_bias, (x, y, z))


@kernel
def _errors(sight, userdata, which, first):
    """Three errors of object ``which`` in a row, see :func:`_error`."""
    x, y = _error(sight, userdata, which, first), _error(sight, userdata, which, first + 1)
    return (x, y, _error(sight, userdata, which, first + 2))


@kernel
def _error(sight, userdata, which, axis):
    """An object's own error: of position along x, y, z (m), then of rotation about x, y, z (rad), world frame."""
    constant, wandering = gaussian(userdata[SEED], which, OBJECT + axis), userdata[sight.errors + 6 * which + axis]
    if axis < 3:
        return sight.position_bias * constant + sight.position_noise * wandering
    return sight.angle_bias * constant + sight.angle_noise * wandering


@kernel
def _see_joint(sight, world, userdata, seen, k):
    """Position and speed of a fixture's joint, read off what is seen of its parts.

    The position is as wrong as the object's pose is along, or about, one axis; the speed, which a filter gets from
    positions, by as much as their noise moves in its correlation time.
    """
    position, speed = joint_pos(world, k), joint_vel(world, k)
    if sight.lag > 0:
        slot = _past(sight, userdata) + sight.joint_slots[k]
        position, speed = userdata[slot], userdata[slot + 1]
    which, hinge = sight.joint_objects[k], sight.joint_kinds[k] == HINGE
    if which != EXACT:
        axis, noise = (ABOUT_Z, sight.angle_noise) if hinge else (ALONG_Z, sight.position_noise)
        position += _error(sight, userdata, which, axis)
        speed += noise / sight.time * userdata[sight.errors + 6 * which + axis - 1]
    doubles(seen.qpos + 8 * seen.joints[k], 1)[0] = position
    doubles(seen.qvel + 8 * seen.dofs[k], 1)[0] = speed


@kernel
def _see_velocity(sight, userdata, seen, k):
    """A velocity that the task keeps, as wrong as a joint's speed: by errors that wander apart from the position's."""
    state = TASK_START + sight.velocity_states[k]
    velocity = vec(userdata, state)
    if sight.lag > 0:
        velocity = vec(userdata, _past(sight, userdata) + sight.velocity_slots[k])
    wandering = vec(userdata, sight.errors + 6 * sight.velocity_objects[k] + 3)
    wrong = scale(sight.position_noise / sight.time, wandering)
    put(doubles(seen.userdata + 8 * state, 3), 0, add(velocity, wrong))


@kernel
def _estimate_robot(perception, world, seen, now, effects):
    """The robot as its controller estimates it: base and tool in error as one, joints and fingers as they are."""
    sight, vehicle = perception.sight[0], perception.vehicle[0]
    mju_copy(seen.qpos, world.qpos, sight.own_qpos)
    mju_copy(seen.qvel, world.qvel, sight.own_qvel)
    tool, base = sight.num_sites, sight.num_sites + 1
    _write_site(seen, tool, tool_pos(world), tool_mat(world))
    _write_site(seen, base, base_pos(world), base_mat(world))
    if world.flies > 0.0:
        joints = vehicle.num_joints
        pos, vel = doubles(world.qpos, 7 + joints), doubles(world.qvel, 6 + joints)
        measured_pos, measured_vel = doubles(seen.qpos, 7 + joints), doubles(seen.qvel, 6 + joints)
        userdata, moment = doubles(world.userdata, USERDATA_SIZE), now_at(now)
        note(moment, userdata[SEED], userdata[TICK], CONTROL_DT_S, pos, vel)
        summed = act_all(perception.hooks[0], world.userdata, moment, effects)
        measure(vehicle, summed, pos, vel, measured_pos, measured_vel)
        rot, measured = _rotation(pos), _rotation(measured_pos)
        turn, there, here = matmul(measured, _transposed(rot)), vec(pos, 0), vec(measured_pos, 0)
        moved = add(here, rotate(turn, sub(tool_pos(world), there)))
        _write_site(seen, tool, moved, matmul(turn, tool_mat(world)))
        _write_site(seen, base, add(here, rotate(turn, sub(base_pos(world), there))), matmul(turn, base_mat(world)))


@kernel
def _feel_forces(sight, world, seen):
    """Copy what the episode remembers of forces and of the task; add the errors of force sensors."""
    mju_copy(seen.userdata + 8 * FORCES_START, world.userdata + 8 * FORCES_START, OWN_MEMORY_STOP - FORCES_START)
    userdata = doubles(world.userdata, USERDATA_SIZE)
    forces = doubles(seen.userdata + 8 * FORCES_START, 3 * sight.num_forces)
    for k in range(sight.num_forces):
        for axis in range(3):
            bias = sight.force_bias * gaussian(userdata[SEED], k, FORCE_BIAS + axis)
            noise = sight.force_noise * gaussian(userdata[SEED], userdata[TICK], FORCE_NOISE + 3 * k + axis)
            forces[3 * k + axis] += bias + noise


@kernel
def _rotation(pos):
    """Rotation matrix of the base in a position vector of a flying robot."""
    return mat_from_quat((pos[3], pos[4], pos[5], pos[6]))


@kernel
def _transposed(m):
    return (m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8])


@kernel
def _write_site(seen, k, pos, mat):
    put(doubles(seen.site_xpos + 24 * k, 3), 0, pos)
    found = doubles(seen.site_xmat + 72 * k, 9)
    for i in range(9):
        found[i] = mat[i]
