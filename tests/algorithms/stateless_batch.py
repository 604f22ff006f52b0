"""What a recording asks of an environment that has no simulator behind it: no actuators, no state, a clock."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from aerial_il.core.contracts import BatchEnvBase
from aerial_il.core.specs import EnvSpec


class StatelessBatch(BatchEnvBase):
    """n worlds of a few numbers each; who inherits it counts ``steps`` (n,) and steps the worlds."""

    spec: EnvSpec
    num_envs: int
    steps: np.ndarray
    model, model_xml = SimpleNamespace(nu=0), "<mujoco/>"

    @property
    def ctrl(self) -> np.ndarray:
        return np.zeros((self.num_envs, 0))

    @property
    def sim_time(self) -> np.ndarray:
        return self.steps * self.spec.control_dt_s

    def get_state(self) -> np.ndarray:
        return np.zeros((self.num_envs, 0))

    def close(self) -> None:
        """There is nothing to free."""
