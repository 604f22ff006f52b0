"""The full state of a foreign environment that runs on MuJoCo, so that its recordings can be continued.

Some environments move bodies and targets by writing into the model when they are reset. Such edits are no part of
MuJoCo's state; the elements that differ between resets are determined once and kept beside it.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
EDITABLE = ("body_pos", "body_quat", "site_pos", "site_quat", "geom_pos", "geom_quat", "geom_size")


class MujocoState:
    """Reads and writes states of worlds of one model.

    Args:
        model: any world's. edited: field of the model -> indices of its flat elements that resets change.
    """

    def __init__(self, model: Any, edited: dict[str, np.ndarray]) -> None:
        self._edited = {name: index for name, index in edited.items() if len(index)}
        self._integration = mujoco.mj_stateSize(model, STATE)
        self.size = self._integration + sum(map(len, self._edited.values()))

    @staticmethod
    def of(resets: list[tuple[Any, dict[str, np.ndarray]]]) -> MujocoState:
        """Determine what resets edit.

        Args:
            resets: after each of several resets, the model and :func:`editable` of it.
        """
        model, first = resets[0]
        others = [fields for _, fields in resets[1:]]
        changed = {name: np.any([other[name] != first[name] for other in others], axis=0) for name in first}
        return MujocoState(model, {name: np.flatnonzero(mask) for name, mask in changed.items()})

    def get(self, model: Any, data: Any) -> np.ndarray:
        """Return (S,) float64."""
        state = np.empty(self._integration)
        mujoco.mj_getState(model, data, state, STATE)
        edits = [getattr(model, name).reshape(-1)[index] for name, index in self._edited.items()]
        return np.concatenate([state, *edits])

    def set(self, model: Any, data: Any, state: np.ndarray) -> None:
        """Put a world into ``state`` (S,), derived quantities included."""
        start = self._integration
        for name, index in self._edited.items():
            getattr(model, name).reshape(-1)[index] = state[start : start + len(index)]
            start += len(index)
        integration = np.ascontiguousarray(state[: self._integration])
        mujoco.mj_setState(model, data, integration, STATE)
        mujoco.mj_forward(model, data)
        mujoco.mj_setState(model, data, integration, STATE)  # what the forward pass wrote is no part of it


def editable(model: Any) -> dict[str, np.ndarray]:
    """Return flat copies of the fields that a reset may have written."""
    return {name: getattr(model, name).reshape(-1).copy() for name in EDITABLE}
