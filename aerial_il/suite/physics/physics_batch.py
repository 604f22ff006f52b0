"""n simulated worlds behind one interface: their states as ``(n, ...)`` arrays, their physics in compiled loops.

Every world has an ``MjData`` of its own. Task and controller code sees arrays with a leading world axis and never asks
how many worlds there are: for many, rows are copied from and to MuJoCo's structures around each flight; for a single
one they are MuJoCo's memory itself, so that a dm_control ``Physics`` shows the same numbers. Both run the same compiled
code and agree bit for bit.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import NamedTuple

import mujoco
import numpy as np
from dm_control import mujoco as dm_mujoco

from aerial_il.core.kernels import kernel
from aerial_il.suite.physics.native import (
    doubles,
    fetch_ahead,
    mj_get_state,
    mj_reset_data,
    mj_set_state,
    mj_step1,
    mju_copy,
    stack_end,
)

STATE = mujoco.mjtState.mjSTATE_INTEGRATION
SIGNATURE = int(STATE)
STATE_FIELDS = ("userdata", "xfrc_applied", "mocap_pos", "mocap_quat", "qpos", "qvel", "ctrl", "qfrc_applied", "act")
USERDATA, XFRC, _, _, QPOS, QVEL, CTRL, QFRC, _ = range(len(STATE_FIELDS))
DERIVED_FIELDS = ("sensordata", "site_xpos", "site_xmat")
SENSORDATA, SITE_XPOS, SITE_XMAT = range(len(STATE_FIELDS), len(STATE_FIELDS) + len(DERIVED_FIELDS))
NUM_STATE_FIELDS = len(STATE_FIELDS)
CONTACT_BYTES, STACK_BYTES = 4096, 16384  # of arena and stack that a step with some contacts uses
LARGE_BYTES = 16384  # fields of a world from which fetching them ahead pays
INFO, COUNT = 0, 1  # columns of a table of warnings


class PhysicsPointers(NamedTuple):
    """Addresses by which compiled code finds the worlds.

    Attributes:
        models, datas: (n,) addresses of MuJoCo's structures.
        inside, outside: (F, n) addresses of each field in MuJoCo's structures and in our arrays; state fields first.
        sizes: (F,) doubles of each field. warnings: (2, n) addresses of MuJoCo's table of warnings and of ours.
        num_warnings: doubles of that table. memory: (n, B, 2) addresses and bytes of what a step of MuJoCo touches.
    """

    models: np.ndarray
    datas: np.ndarray
    inside: np.ndarray
    outside: np.ndarray
    sizes: np.ndarray
    warnings: np.ndarray
    num_warnings: int
    memory: np.ndarray


@kernel
def inside(pointers, field, i):
    """A field of world ``i`` in MuJoCo's memory, flat."""
    return doubles(pointers.inside[field, i], pointers.sizes[field])


@kernel
def outside(pointers, field, i):
    """The same in our arrays."""
    return doubles(pointers.outside[field, i], pointers.sizes[field])


@kernel
def push_state(pointers, i, first=USERDATA):
    """Copy everything of world ``i`` that may have been written from outside to MuJoCo.

    Args:
        first: field to begin with: :data:`XFRC` leaves out the userdata, which MuJoCo does not read.
    """
    for field in range(first, NUM_STATE_FIELDS):
        if pointers.inside[field, i] != pointers.outside[field, i]:
            mju_copy(pointers.inside[field, i], pointers.outside[field, i], pointers.sizes[field])


@kernel
def pull_all(pointers, i, first=USERDATA):
    """Copy state, derived quantities and warnings of world ``i`` from MuJoCo to our arrays.

    Args:
        first: field to begin with: :data:`QPOS` leaves out what physics steps do not change.
    """
    for field in range(first, pointers.sizes.size):
        if pointers.inside[field, i] != pointers.outside[field, i]:
            mju_copy(pointers.outside[field, i], pointers.inside[field, i], pointers.sizes[field])
    mju_copy(pointers.warnings[1, i], pointers.warnings[0, i], pointers.num_warnings)


@kernel
def fetch_part(pointers, i, part, parts):
    """Ask for one of some parts of the memory of world ``i``, which is soon to fly."""
    for k in range(pointers.memory.shape[1]):
        size = pointers.memory[i, k, 1] // parts
        fetch_ahead(pointers.memory[i, k, 0] + part * size, size)


@kernel
def _clear(pointers, active):
    for i in range(active.size):
        if active[i]:
            mj_reset_data(pointers.models[i], pointers.datas[i])
            pull_all(pointers, i)


@kernel
def _forward(pointers, active):
    for i in range(active.size):
        if active[i]:
            push_state(pointers, i)
            mj_step1(pointers.models[i], pointers.datas[i])
            pull_all(pointers, i)


@kernel
def _get_states(pointers, rows, size):
    for i in range(pointers.datas.size):
        push_state(pointers, i)
        mj_get_state(pointers.models[i], pointers.datas[i], rows + 8 * i * size, SIGNATURE)


@kernel
def _set_states(pointers, active, rows, size):
    for i in range(active.size):
        if active[i]:
            mj_set_state(pointers.models[i], pointers.datas[i], rows + 8 * i * size, SIGNATURE)
            mj_step1(pointers.models[i], pointers.datas[i])
            pull_all(pointers, i)


@kernel
def _first_warned(warnings, active):
    for i in range(active.size):
        for kind in range(warnings.shape[1]):
            if active[i] and warnings[i, kind, COUNT] != 0:
                return i
    return active.size


class PhysicsBatch:
    """State of n worlds of one scene.

    Args:
        model: compiled scene.
        datas: one ``MjData`` per world. A single one is shown in place, several are copied.
    """

    def __init__(self, model: mujoco.MjModel, datas: list[mujoco.MjData]) -> None:
        self.model, self.n, self._datas = model, len(datas), datas
        self._models = [model] * self.n
        self._arrays = {name: self._array(name) for name in (*STATE_FIELDS, *DERIVED_FIELDS)}
        self._warnings = np.zeros((self.n, len(datas[0].warning.number), 2), np.int32)
        self._size = mujoco.mj_stateSize(model, SIGNATURE)
        self._everyone = np.ones(self.n, bool)
        self.pointers = self._pointers()
        self.clear()

    @staticmethod
    def many(model: mujoco.MjModel, n: int) -> PhysicsBatch:
        """Return n new worlds."""
        return PhysicsBatch(model, [mujoco.MjData(model) for _ in range(n)])

    @staticmethod
    def of(physics: Physics) -> PhysicsBatch:
        """Return the world of a :class:`Physics`."""
        return PhysicsBatch(physics.model.ptr, [physics.data.ptr])

    def bind(self, name: str) -> np.ndarray:
        """Live (n, ...) array of an ``MjData`` field of doubles; what is written to a state field counts."""
        if name not in self._arrays:
            self._arrays[name] = self._array(name)
            self.pointers = self._pointers()
        return self._arrays[name]

    def clear(self, active: np.ndarray | None = None) -> None:
        """Reset to the model's defaults, without computing anything derived, the worlds in ``active`` (n,) bool."""
        _clear(self.pointers, self._everyone if active is None else active)

    def forward(self, active: np.ndarray | None = None) -> None:
        """Make position- and velocity-dependent quantities current in the worlds of ``active`` (n,) bool."""
        _forward(self.pointers, self._everyone if active is None else active)

    def get_state(self) -> np.ndarray:
        """Copy of the integration states, (n, S)."""
        states = np.empty((self.n, self._size))
        _get_states(self.pointers, states.ctypes.data, self._size)
        return states

    def set_state(self, states: np.ndarray, active: np.ndarray | None = None) -> None:
        """Write integration states (n, S) of the worlds in ``active`` (n,) and make derived quantities current."""
        active = self._everyone if active is None else active
        rows = np.ascontiguousarray(states, float)
        for i in np.flatnonzero(active):
            self._datas[i].warning.number[:] = 0
        _set_states(self.pointers, active, rows.ctypes.data, self._size)

    def own_model(self, world: int) -> mujoco.MjModel:
        """Model of one world alone, to be edited; it stays its own from the first call on."""
        if self.n > 1 and self._models[world] is self.model:
            self._models[world] = copy.copy(self.model)
            self.pointers.models[world] = self._models[world]._address
        return self._models[world]

    def first_warned(self, active: np.ndarray) -> int:
        """The first world in ``active`` (n,) that MuJoCo warned about since it was cleared or set; n if there is none.

        The physics of such a world cannot be trusted.
        """
        return _first_warned(self._warnings, active)

    def warning(self, world: int) -> str:
        """Text of MuJoCo's warning about a world."""
        table = self._warnings[world]
        kind = int(np.flatnonzero(table[:, COUNT])[0])
        return mujoco.mju_warningText(kind, int(table[kind, INFO]))

    def data(self, world: int) -> mujoco.MjData:
        """One world as an ``MjData`` of its model."""
        push_state(self.pointers, world)
        return self._datas[world]

    def _array(self, name: str) -> np.ndarray:
        fields = [getattr(data, name) for data in self._datas]
        return fields[0][None] if self.n == 1 else np.stack(fields)

    def _pointers(self) -> PhysicsPointers:
        rows = list(self._arrays.items())
        return PhysicsPointers(
            models=np.array([model._address for model in self._models], np.int64),
            datas=np.array([data._address for data in self._datas], np.int64),
            inside=np.array([[_address(getattr(data, name)) for data in self._datas] for name, _ in rows], np.int64),
            outside=np.array([[_address(row) for row in array] for _, array in rows], np.int64),
            sizes=np.array([array[0].size for _, array in rows], np.int32),
            warnings=np.array(
                [[_address(data.warning.lastinfo) for data in self._datas], [_address(row) for row in self._warnings]],
                np.int64,
            ),
            num_warnings=self._warnings.shape[1],
            memory=np.array([_memory(data) for data in self._datas], np.int64),
        )


class Physics(dm_mujoco.Physics):
    """A dm_control Physics, with its named indexing and rendering, whose steps are flown by us.

    Attributes:
        fly: advances the given number of physics steps, controller and air included.
    """

    fly: Callable[[int], None]

    def __repr__(self) -> str:
        return f"Physics({self.model.nq} positions, {self.model.nv} velocities, {self.time():.2f} s)"

    def step(self, nstep: int = 1) -> None:
        """Advance ``nstep`` physics steps, each with its own tick of the controller."""
        self.fly(nstep)

    def after_reset(self) -> None:
        mujoco.mj_step1(self.model.ptr, self.data.ptr)


def _address(array: np.ndarray) -> int:
    return array.ctypes.data if array.size else 0


def _memory(data: mujoco.MjData) -> list[tuple[int, int]]:
    """Addresses and bytes of a world's fields, of the beginning of its arena and of the end of its stack."""
    if data.nbuffer < LARGE_BYTES:
        return [(0, 0)] * 3
    end = stack_end(data)
    stack, arena = (end - STACK_BYTES, STACK_BYTES), (end - data.narena, CONTACT_BYTES)
    return [(_address(data.qpos), data.nbuffer), arena, stack]
