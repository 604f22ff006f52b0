"""n simulated worlds behind one interface: MuJoCo's batch engine, or one dm_control Physics shown as n = 1.

Task and controller code sees ``(n, ...)`` arrays that are live views of the simulator's own memory and never asks which
of the two it runs on. Both advance by single physics steps that leave position- and velocity-dependent quantities
current, and agree bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

import mujoco
import numpy as np
from dm_control import mujoco as dm_mujoco
from mujoco import batch as mujoco_batch

STATE = mujoco.mjtState.mjSTATE_INTEGRATION
VELOCITY_STAGE = int(mujoco.mjtStage.mjSTAGE_VEL)
NO_STAGE = int(mujoco.mjtStage.mjSTAGE_NONE)
INFO, COUNT = 0, 1  # columns of a table of warnings


class PhysicsError(Exception):
    """MuJoCo gave up on the world with index ``world``."""

    def __init__(self, world: int, message: str) -> None:
        self.world = world
        super().__init__(message)


class Worlds(Protocol):
    """Simulator state of n worlds of one model."""

    n: int
    model: mujoco.MjModel

    def bind(self, name: str) -> np.ndarray:
        """Live (n, ...) array of an ``MjData`` field."""
        ...

    def step(self, ids: np.ndarray | None) -> None:
        """Advance the worlds ``ids`` (None: all) by one physics step."""
        ...

    def clear(self, ids: np.ndarray | None) -> None:
        """Reset to the model's defaults without computing anything derived."""
        ...

    def forward(self, ids: np.ndarray | None) -> None:
        """Make position- and velocity-dependent quantities current."""
        ...

    def get_state(self) -> np.ndarray:
        """Copy of the integration states, (n, S)."""
        ...

    def set_state(self, states: np.ndarray, ids: np.ndarray | None) -> None:
        """Write integration states (n, S) of the worlds ``ids`` and make derived quantities current."""
        ...

    def warned(self) -> np.ndarray:
        """(n,) bool: MuJoCo warned about the world since it was cleared or set; its physics cannot be trusted."""
        ...

    def warning(self, world: int) -> str:
        """What it warned about."""
        ...

    def data(self, world: int) -> mujoco.MjData:
        """One world as an ``MjData`` to render or to inspect."""
        ...


class BatchWorlds:
    """Many worlds on MuJoCo's thread pool.

    Args:
        model: compiled scene. n: number of worlds. num_threads: 0 for all cores.
    """

    def __init__(self, model: mujoco.MjModel, n: int, num_threads: int = 0) -> None:
        self.model, self.n = model, n
        self._batch = mujoco_batch.Batch(model, n, num_threads, persistent=True)
        self._view = mujoco.MjData(model)

    def bind(self, name: str) -> np.ndarray:
        return self._batch.bind(name)

    def step(self, ids: np.ndarray | None) -> None:
        with _failures():
            self._batch.step(ids, 1, VELOCITY_STAGE)

    def clear(self, ids: np.ndarray | None) -> None:
        self._batch.reset(ids, stage=NO_STAGE)

    def forward(self, ids: np.ndarray | None) -> None:
        with _failures():
            self._batch.forward(ids, VELOCITY_STAGE)

    def get_state(self) -> np.ndarray:
        return self._batch.state.copy()

    def set_state(self, states: np.ndarray, ids: np.ndarray | None) -> None:
        rows = slice(None) if ids is None else ids
        self._batch.state[rows] = states[rows]
        self._batch.warning[rows] = 0
        self.forward(ids)

    def warned(self) -> np.ndarray:
        return self._batch.warning[:, :, COUNT].any(axis=1)

    def warning(self, world: int) -> str:
        return _first_warning(self._batch.warning[world])

    def data(self, world: int) -> mujoco.MjData:
        return self._batch.get_data(world, self._view)


class Physics(dm_mujoco.Physics):
    """A dm_control Physics, with its named indexing and rendering, that steps and resets as the batch engine does.

    Attributes:
        before_step: called before every single physics step; the low-level controller hooks in here.
    """

    before_step: Callable[[], None]

    @staticmethod
    def from_mujoco(model: mujoco.MjModel) -> Physics:
        """Wrap a compiled model."""
        physics = Physics.from_model(dm_mujoco.wrapper.MjModel(model))
        physics.before_step = lambda: None
        return physics

    def step(self, nstep: int = 1) -> None:
        """Advance ``nstep`` physics steps, each with its own call of :attr:`before_step`."""
        for _ in range(nstep):
            self.before_step()
            self.advance()

    def advance(self) -> None:
        """One physics step from current position- and velocity-dependent quantities to the next."""
        with _failures():
            mujoco.mj_step2(self.model.ptr, self.data.ptr)
            mujoco.mj_step1(self.model.ptr, self.data.ptr)

    def after_reset(self) -> None:
        mujoco.mj_step1(self.model.ptr, self.data.ptr)


class SingleWorlds:
    """The :class:`Worlds` view of a :class:`Physics`."""

    n = 1

    def __init__(self, physics: Physics) -> None:
        self.physics, self.model = physics, physics.model.ptr
        self._data = physics.data.ptr

    def bind(self, name: str) -> np.ndarray:
        return getattr(self._data, name)[None]

    def step(self, ids: np.ndarray | None) -> None:
        self.physics.advance()

    def clear(self, ids: np.ndarray | None) -> None:
        mujoco.mj_resetData(self.model, self._data)

    def forward(self, ids: np.ndarray | None) -> None:
        with _failures():
            mujoco.mj_step1(self.model, self._data)

    def get_state(self) -> np.ndarray:
        state = np.empty(mujoco.mj_stateSize(self.model, STATE))
        mujoco.mj_getState(self.model, self._data, state, STATE)
        return state[None]

    def set_state(self, states: np.ndarray, ids: np.ndarray | None) -> None:
        mujoco.mj_setState(self.model, self._data, states[0], STATE)
        for warning in self._data.warning:
            warning.number = 0
        self.forward(ids)

    def warned(self) -> np.ndarray:
        return np.array([any(warning.number for warning in self._data.warning)])

    def warning(self, world: int) -> str:
        return _first_warning(np.array([[w.lastinfo, w.number] for w in self._data.warning]))

    def data(self, world: int) -> mujoco.MjData:
        return self._data


@contextmanager
def _failures() -> Iterator[None]:
    """Raise MuJoCo's own errors as :class:`PhysicsError`."""
    try:
        yield
    except mujoco_batch.SimulationError as error:
        raise PhysicsError(int(error.ids[0]), str(error)) from error
    except mujoco.FatalError as error:
        raise PhysicsError(0, str(error)) from error


def _first_warning(table: np.ndarray) -> str:
    """MuJoCo's sentence for the first kind of warning that was counted in ``table`` (kinds, 2)."""
    kind = int(np.flatnonzero(table[:, COUNT])[0])
    return mujoco.mju_warningText(kind, int(table[kind, INFO]))
