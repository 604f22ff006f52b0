"""A batch environment around another one, to change a little of what it answers."""

from __future__ import annotations

from typing import Any

import numpy as np

from aerial_il.core.contracts import Actuated, BatchEnv, StepResult
from aerial_il.core.goals import GoalSpec
from aerial_il.core.specs import EnvSpec


class BatchEnvWrapper:
    """Passes everything on; subclasses override what they change.

    Args:
        env: the environment inside.
    """

    def __init__(self, env: BatchEnv) -> None:
        self.env = env

    @property
    def num_envs(self) -> int:
        return self.env.num_envs

    @property
    def spec(self) -> EnvSpec:
        return self.env.spec

    @property
    def ends_at_success(self) -> bool:
        return self.env.ends_at_success

    @property
    def engine(self) -> str | None:
        return self.env.engine

    @property
    def goal_spec(self) -> GoalSpec | None:
        return self.env.goal_spec

    @property
    def camera_names(self) -> tuple[str, ...]:
        return self.env.camera_names

    @property
    def model(self) -> Actuated:
        return self.env.model

    @property
    def model_xml(self) -> str:
        return self.env.model_xml

    @property
    def seeds(self) -> np.ndarray:
        return self.env.seeds

    @property
    def ctrl(self) -> np.ndarray:
        return self.env.ctrl

    @property
    def sim_time(self) -> np.ndarray:
        return self.env.sim_time

    def drawn(self, seed: int) -> dict[str, Any]:
        return self.env.drawn(seed)

    def reset(self, seeds: np.ndarray | int, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        return self.env.reset(seeds, mask)

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        return self.env.step(actions, mask)

    def observe(self) -> dict[str, np.ndarray]:
        return self.env.observe()

    def get_state(self) -> np.ndarray:
        return self.env.get_state()

    def set_state(self, states: np.ndarray, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        return self.env.set_state(states, mask)

    def render(self, world: int = 0, camera: str = "scene", height: int = 240, width: int = 320) -> np.ndarray:
        return self.env.render(world, camera, height, width)

    def close(self) -> None:
        self.env.close()
