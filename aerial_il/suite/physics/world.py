"""One world as the compiled code of a task sees it: where the robot is, where the props are, who touches whom.

A task is written once, for one world, as compiled functions of a :data:`WORLD` record; the threads that fly the worlds
call them through their addresses right after each flight, single and batch alike. Names become numbers when a record is
made: a task lists the names it uses (:class:`Names`) and reads the k-th of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numba import types

from aerial_il.control.dynamics import put, vec
from aerial_il.control.vehicle import MAX_JOINTS
from aerial_il.core.addresses import called, intrinsic, read_at
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import add, scale
from aerial_il.suite.physics import episode_state as layout
from aerial_il.suite.physics.native import doubles

MAX_NAMES = 8  # of each kind that a task may use
FORCES_START, PEAKS_START = layout.FORCES.start, layout.FORCES.start + 3 * layout.MAX_FORCES
SAMPLES_START, SEED, TICK = layout.SAMPLES.start, layout.SEED, layout.TICK
TASK_START, TASK_SIZE = layout.TASK.start, layout.TASK.stop - layout.TASK.start
THRUST_START, AIR_START = layout.THRUST.start, layout.AIR.start
ARRAYS = ("qpos", "qvel", "sensordata", "site_xpos", "site_xmat", "mocap_pos", "ctrl", "userdata")

WORLD = np.dtype(
    [
        *((name, np.int64) for name in ARRAYS),  # addresses of this world's numbers
        *((name, np.int64, (MAX_NAMES,)) for name in ("sites", "joints", "dofs", "contacts", "mocaps", "actuators")),
        *((name, np.int64) for name in ("tool", "base", "first_joint", "first_dof", "num_joints", "fingers")),
        *((name, np.int64) for name in ("num_rotors", "num_unwanted")),
        ("unwanted", np.int64, (1 + MAX_JOINTS,)),  # contact sensors that should see nothing: base and links
        *((name, np.float64) for name in ("flies", "grips", "stroke", "tip_distance", "longest_reach")),
        *((name, np.float64) for name in ("weight", "lateral_limit")),
    ],
    align=True,
)
RECORD = numba.from_dtype(WORLD)
NUMBER, VECTOR, ROW = types.float64, types.UniTuple(types.float64, 3), types.Array(types.float64, 1, "C")


@dataclass(frozen=True)
class Names:
    """Names that a task reads, in the order in which its compiled functions number them.

    Attributes:
        sites, joints, contacts, mocaps: names of sites, of joints, of contact sensors (or others of one number) and of
            mocap bodies.
        actuators: names of the props' own.
    """

    sites: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    contacts: tuple[str, ...] = ()
    mocaps: tuple[str, ...] = ()
    actuators: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for kind, names in vars(self).items():
            if len(names) > MAX_NAMES:
                raise InvalidValueError(f"A task names at most {MAX_NAMES} {kind}; got {len(names)}: {names}.")


@intrinsic
def record_at(_: Any, address: types.Integer) -> Any:
    """Take an address as that of a :data:`WORLD` record."""
    return RECORD(address), read_at


@intrinsic
def call_number(_: Any, address: types.Integer, world: types.Record) -> Any:
    return NUMBER(address, world), called(NUMBER, RECORD)


@intrinsic
def call_vector(_: Any, address: types.Integer, world: types.Record) -> Any:
    return VECTOR(address, world), called(VECTOR, RECORD)


@intrinsic
def call_row(_: Any, address: types.Integer, world: types.Record, row: types.Array) -> Any:
    return types.void(address, world, row), called(types.void, RECORD, ROW)


@intrinsic
def call_nothing(_: Any, address: types.Integer, world: types.Record) -> Any:
    return types.void(address, world), called(types.void, RECORD)


@intrinsic
def call_sensor(_: Any, address: Any, own: Any, world: Any, seen: Any, row: Any) -> Any:
    return types.void(address, own, world, seen, row), called(types.void, own, RECORD, RECORD, ROW)


RETURNS_NUMBER, RETURNS_VECTOR = NUMBER(RECORD), VECTOR(RECORD)
WRITES_ROW, RETURNS_NOTHING = types.void(RECORD, ROW), types.void(RECORD)


@kernel
def put_rot6d(found, start, mat):
    """Write the first two columns of a rotation: six numbers from ``start`` on."""
    put(found, start, (mat[0], mat[3], mat[6]))
    put(found, start + 3, (mat[1], mat[4], mat[7]))


@kernel
def _point(address, k):
    """Vector number ``k`` of those at an address."""
    return vec(doubles(address + 24 * k, 3), 0)


@kernel
def _matrix(address, k):
    """Rotation number ``k`` of those at an address: nine numbers, row by row."""
    m = doubles(address + 72 * k, 9)
    return (m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8])


@kernel
def site_pos(world, k):
    """Position of the task's site number ``k``, world frame, m."""
    return _point(world.site_xpos, world.sites[k])


@kernel
def site_mat(world, k):
    """Rotation of that site, world from site."""
    return _matrix(world.site_xmat, world.sites[k])


@kernel
def tool_pos(world):
    """Tool position, world frame, m."""
    return _point(world.site_xpos, world.tool)


@kernel
def tool_mat(world):
    """Rotation, world from tool."""
    return _matrix(world.site_xmat, world.tool)


@kernel
def tip_pos(world):
    """Point between the fingers' ends, world frame, m: what touches first when the closed gripper pushes."""
    m = tool_mat(world)
    return add(tool_pos(world), scale(world.tip_distance, (m[0], m[3], m[6])))


@kernel
def base_pos(world):
    """Base position, world frame, m."""
    return _point(world.site_xpos, world.base)


@kernel
def base_mat(world):
    """Rotation, world from base."""
    return _matrix(world.site_xmat, world.base)


@kernel
def joint_pos(world, k):
    """Position of the task's joint number ``k``, a hinge (rad) or slide (m)."""
    return doubles(world.qpos + 8 * world.joints[k], 1)[0]


@kernel
def joint_vel(world, k):
    """Velocity of that joint, rad/s or m/s."""
    return doubles(world.qvel + 8 * world.dofs[k], 1)[0]


@kernel
def free_vel(world, k):
    """Linear velocity of the task's joint number ``k``, a free one, world frame, m/s."""
    return vec(doubles(world.qvel + 8 * world.dofs[k], 3), 0)


@kernel
def mocap_pos(world, k):
    """Position of the task's mocap body number ``k``, world frame, m: three numbers that may be written."""
    return doubles(world.mocap_pos + 24 * world.mocaps[k], 3)


@kernel
def mocap_pos_after(world, k, places):
    """Position of the mocap body that was added ``places`` after the task's number ``k``, as :func:`mocap_pos`."""
    return doubles(world.mocap_pos + 24 * (world.mocaps[k] + places), 3)


@kernel
def touching(world, k):
    """Whether the task's contact sensor number ``k`` sees at least one contact."""
    return doubles(world.sensordata + 8 * world.contacts[k], 1)[0] > 0.0


@kernel
def reading(world, k):
    """Number that sensor number ``k`` of those in the task's ``contacts`` gives, in its own unit."""
    return doubles(world.sensordata + 8 * world.contacts[k], 1)[0]


@kernel
def set_point(world, k):
    """Set-point of the task's actuator number ``k``: one number that may be written."""
    return doubles(world.ctrl + 8 * world.actuators[k], 1)


@kernel
def unwanted_contacts(world):
    """Robot parts, the gripper aside, that touch something."""
    count = 0
    for j in range(world.num_unwanted):
        if doubles(world.sensordata + 8 * world.unwanted[j], 1)[0] > 0.0:
            count += 1
    return count


@kernel
def untouched(world):
    """Whether no part of the robot but the gripper touches anything."""
    return unwanted_contacts(world) == 0


@kernel
def force(world, k):
    """Contact force that the task's force sensor number ``k`` measures, world frame, N."""
    return _point(world.userdata + 8 * FORCES_START, k)


@kernel
def peak_force(world, k):
    """Largest magnitude of that force since the start of the episode, N."""
    return doubles(world.userdata + 8 * (PEAKS_START + k), 1)[0]


@kernel
def force_sample(world, step):
    """Force that the task's first sensor measured after physics step ``step`` of the last control step, world, N."""
    return _point(world.userdata + 8 * SAMPLES_START, 2 * step)


@kernel
def raw_force_sample(world, step):
    """The contact solver's force from which that was measured, before the sensor's filter, world frame, N."""
    return _point(world.userdata + 8 * SAMPLES_START, 2 * step + 1)


@kernel
def gripper_opening(world):
    """Opening of the gripper: 0 closed, 1 open."""
    fingers = doubles(world.qpos + 8 * world.fingers, 2)
    return 0.5 * (fingers[0] + fingers[1]) / world.stroke


@kernel
def task_state(world):
    """(8,) numbers that the task may write once per control step; zero at the start of an episode."""
    return doubles(world.userdata + 8 * TASK_START, TASK_SIZE)


@kernel
def seed(world):
    """Seed of the episode, an integer."""
    return doubles(world.userdata + 8 * SEED, 1)[0]


@kernel
def tick(world):
    """Physics steps since the start of the episode, an integer."""
    return doubles(world.userdata + 8 * TICK, 1)[0]


@kernel
def air_force(world):
    """Wind, drag and ground effect on the base in the last physics step, world frame, N."""
    return _point(world.userdata + 8 * AIR_START, 0)


@kernel
def rotor_thrust(world, count):
    """Thrusts (count,) of the rotors, N."""
    return doubles(world.userdata + 8 * THRUST_START, count)
