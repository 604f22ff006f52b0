"""One dm_env environment as a world: array specifications become named fields."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import dm_env
import numpy as np
from dm_env import specs

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.goals import GoalSpec
from aerial_il.core.specs import ActionSpec, Field, ObservationSpec
from aerial_il.suite.outside.gymnasium_world import DEFAULT_DT_S, bounded, is_image
from aerial_il.suite.outside.world import Outcome

MakeEnv = Callable[[int], dm_env.Environment]
TERMINAL_DISCOUNT = 0.0


class DmEnvWorld:
    """A world that makes a new environment for each seed, which no memory can survive; see :class:`World`."""

    goal_spec: GoalSpec | None = None

    def __init__(self, make: MakeEnv) -> None:
        self._make = make
        self._env = make(0)
        self._spec: Any = self._env.action_spec()
        shown: Any = self._env.observation_spec()
        fields = shown.items() if _is_mapping(shown) else (("observation", shown),)
        self.observation = ObservationSpec(tuple(_field(name, each) for name, each in fields))
        self.action = action_spec(self._spec)
        timestep: Any = getattr(self._env, "control_timestep", None)
        self.control_dt_s = float(timestep()) if timestep else DEFAULT_DT_S
        limit = getattr(self._env, "_step_limit", None)
        self.max_steps: int | None = int(np.ceil(limit)) if limit and np.isfinite(limit) else None

    def reset(self, seed: int) -> Outcome:
        self._env.close()
        self._env = self._make(seed)
        limited: Any = self._env
        while "_step_limit" not in vars(limited) and (inner := getattr(limited, "_env", None)):  # dm_control's wrappers
            limited = inner
        if "_step_limit" in vars(limited):
            vars(limited)["_step_limit"] = math.inf  # the batch keeps the time
        return Outcome(self._named(self._env.reset().observation))

    def executed(self, action: np.ndarray) -> np.ndarray:
        if isinstance(self._spec, specs.DiscreteArray):
            return np.eye(self._spec.num_values)[int(np.argmax(action))]
        return action.astype(self._spec.dtype).astype(float)

    def step(self, action: np.ndarray) -> Outcome:
        if isinstance(self._spec, specs.DiscreteArray):
            chosen: Any = np.asarray(int(np.argmax(action)), self._spec.dtype)
        else:
            chosen = action.astype(self._spec.dtype).reshape(self._spec.shape)
        timestep = self._env.step(chosen)
        ended, lost = timestep.last(), timestep.discount == TERMINAL_DISCOUNT
        reward = float(timestep.reward if timestep.reward is not None else 0.0)
        return Outcome(self._named(timestep.observation), reward, bool(ended and lost), bool(ended and not lost))

    def observe(self) -> dict[str, np.ndarray]:
        task: Any = getattr(self._env, "task", None)
        if not hasattr(task, "get_observation") or not hasattr(self._env, "physics"):
            raise InvalidValueError(f"{type(self._env).__name__} does not say what it shows after its state was set.")
        return self._named(task.get_observation(self._env.physics))  # pyright: ignore[reportAttributeAccessIssue]

    def physics(self) -> tuple[Any, Any] | None:
        physics: Any = getattr(self._env, "physics", None)
        model: Any = getattr(physics, "model", None)
        data: Any = getattr(physics, "data", None)
        return (model.ptr, data.ptr) if hasattr(model, "ptr") and hasattr(data, "ptr") else None

    def close(self) -> None:
        self._env.close()

    def _named(self, obs: Any) -> dict[str, np.ndarray]:
        given = obs if _is_mapping(obs) else {"observation": obs}
        return {f.name: np.array(given[f.name], dtype=f.dtype).reshape(f.shape) for f in self.observation.fields}


def action_spec(spec: Any) -> ActionSpec:
    """Return what an environment takes, as a bounded vector.

    Raises:
        InvalidValueError: a specification without finite bounds.
    """
    if isinstance(spec, specs.DiscreteArray):
        low, high = np.zeros(spec.num_values), np.ones(spec.num_values)
    elif isinstance(spec, specs.BoundedArray) and np.isfinite([spec.minimum, spec.maximum]).all():
        bounds = (spec.minimum, spec.maximum)
        low, high = (np.broadcast_to(bound, spec.shape).reshape(-1).astype(float) for bound in bounds)
    else:
        raise InvalidValueError(f"Actions are a BoundedArray with finite bounds or a DiscreteArray, got {spec}.")
    return bounded(low, high, tuple((spec.name or "").split("\t")))  # dm_control joins the actuators' names so


def _is_mapping(shown: Any) -> bool:
    return hasattr(shown, "items")


def _field(name: str, spec: Any) -> Field:
    if is_image(spec.shape, spec.dtype):
        return Field(name, spec.shape, "image", "uint8")
    return Field(name, spec.shape or (1,), "task" if "target" in name or "goal" in name else "proprio")
