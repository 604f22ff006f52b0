"""Scenes redrawn: recorded moments in which objects are moved aside, so that no two frames show the same scene.

A few hundred flights show as many scenes, however many frames they have, and a network learns scenes by heart. So
objects are moved about and turned where demonstrations differ in them, each frame anew, and the simulator says what is
then to be seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

HELD_M = 0.07  # from the tool: what is nearer may be in the gripper, and stays there
REACHES_M = (0.02, 0.08, 0.25)  # deviations of the displacement, one of them for each frame
VARIES_M, VARIES_RAD = 1e-3, 1e-2
STATE = mujoco.mjtState.mjSTATE_INTEGRATION


@dataclass(frozen=True, eq=False)
class Movable:
    """An object that stands elsewhere in each flight: ``pos`` and ``quat``, where its pose is in a state's arrays.

    Attributes:
        mocap: whether it is a fixture (mocap) rather than free. index: of its first number, or of the fixture.
        axes: (3,) bool, along which it differs. turns: whether it differs in heading.
    """

    mocap: bool
    index: int
    axes: np.ndarray
    turns: bool


class Redrawing:
    """Moves objects about in recorded states of one scene.

    Args:
        model: of the scene. starts: (E, S) first states of several flights, whose differences say what may move.
    """

    def __init__(self, model: mujoco.MjModel, starts: np.ndarray) -> None:
        self._model, self._data = model, mujoco.MjData(model)
        poses = [self._poses(state) for state in starts]
        self.movable = [_movable(key, np.array([each[key] for each in poses])) for key in poses[0]]
        self.movable = [each for each in self.movable if each.axes.any() or each.turns]

    def redrawn(self, states: np.ndarray, tools: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return states (n, S) in which the objects are elsewhere, but for what is at the tools (n, 3) m."""
        return np.stack([self._moved(state, tool, rng) for state, tool in zip(states, tools, strict=True)])

    def _moved(self, state: np.ndarray, tool: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        mujoco.mj_setState(self._model, self._data, state, STATE)
        reach = REACHES_M[rng.integers(len(REACHES_M))]
        for each in self.movable:
            pos, quat = self._pose(each.mocap, each.index)
            step, turn = reach * rng.standard_normal(3) * each.axes, np.zeros(4)
            mujoco.mju_axisAngle2Quat(
                turn, np.array([0.0, 0.0, 1.0]), rng.uniform(-np.pi, np.pi) if each.turns else 0.0
            )
            if np.linalg.norm(pos - tool) > HELD_M or each.mocap:
                pos += step
                mujoco.mju_mulQuat(quat, turn, quat.copy())
        moved = np.empty_like(state)
        mujoco.mj_getState(self._model, self._data, moved, STATE)
        return moved

    def _poses(self, state: np.ndarray) -> dict[tuple[bool, int], np.ndarray]:
        """Return the poses (7,) of all free objects but the robot, and of all fixtures."""
        mujoco.mj_setState(self._model, self._data, state, STATE)
        free = [i for i in range(self._model.njnt) if self._model.jnt_type[i] == mujoco.mjtJoint.mjJNT_FREE]
        keys = [(False, int(self._model.jnt_qposadr[i])) for i in free if self._model.jnt_qposadr[i] > 0]
        keys += [(True, i) for i in range(self._model.nmocap)]
        return {key: np.concatenate(self._pose(*key)) for key in keys}

    def _pose(self, mocap: bool, index: int) -> tuple[np.ndarray, np.ndarray]:
        """Return views of an object's position (3,) and quaternion (4,)."""
        if mocap:
            return self._data.mocap_pos[index], self._data.mocap_quat[index]
        return self._data.qpos[index : index + 3], self._data.qpos[index + 3 : index + 7]


def _movable(key: tuple[bool, int], poses: np.ndarray) -> Movable:
    turned = 2.0 * np.arccos(np.clip(np.abs(poses[:, 3:] @ poses[0, 3:]), 0.0, 1.0))
    return Movable(*key, poses[:, :3].std(0) > VARIES_M, bool(turned.max() > VARIES_RAD))


def first_states(flights: Sequence[np.ndarray]) -> np.ndarray:
    """Return the first state (E, S) of each flight (T + 1, S)."""
    return np.stack([states[0] for states in flights])
