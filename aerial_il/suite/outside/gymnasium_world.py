"""One Gymnasium environment as a world: spaces become named fields, seeds become episodes.

A ``Box`` is one field, a ``Dict`` one field per entry, every other space the vector that Gymnasium flattens it to.
Among several actions to choose from (``Discrete``), an action is a score for each and the highest is taken.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.goals import GoalSpec
from aerial_il.core.specs import ActionSpec, Field, Group, ObservationSpec
from aerial_il.suite.outside.world import Outcome

LEVEL = "native"
DEFAULT_DT_S = 0.05  # of environments that do not say how much time passes between two actions


class GymnasiumWorld:
    """A world made by ``gymnasium.make`` without a time limit of its own; see :class:`World`."""

    def __init__(self, name: str, settings: Mapping[str, Any]) -> None:
        self._env = make(name, settings)
        made = self._env.spec  # of the newest version, where the name says none
        registered = gymnasium.spec(made.id if made else name.rpartition(":")[2])
        self.max_steps: int | None = registered.max_episode_steps
        self.observation = observation_spec(self._env.observation_space)
        self.action = action_spec(self._env.action_space, actuators(self._env.unwrapped))
        self.control_dt_s = control_dt_s(self._env)
        self.goal_spec = goal_of(self._env)

    def reset(self, seed: int) -> Outcome:
        obs, info = self._env.reset(seed=seed)
        return Outcome(self._named(obs), info=info)

    def executed(self, action: np.ndarray) -> np.ndarray:
        space = self._env.action_space
        if isinstance(space, spaces.Discrete):
            return np.eye(int(space.n))[int(np.argmax(action))]
        return action.astype(space.dtype or float).astype(float)

    def step(self, action: np.ndarray) -> Outcome:
        space = self._env.action_space
        if isinstance(space, spaces.Discrete):
            chosen: Any = space.start + int(np.argmax(action))
        else:
            chosen = action.astype(space.dtype or float).reshape(space.shape or ())
        obs, reward, terminated, truncated, info = self._env.step(chosen)
        return Outcome(self._named(obs), float(reward), bool(terminated), bool(truncated), info)

    def observe(self) -> dict[str, np.ndarray]:
        look = getattr(self._env.unwrapped, "_get_obs", None)
        if look is None or self._env.unwrapped.observation_space != self._env.observation_space:
            raise InvalidValueError(f"{self._env} does not say what it shows after its state was set.")
        try:
            return self._named(look())
        except TypeError as error:
            raise InvalidValueError(
                f"{self._env} cannot say what it shows after its state was set ({error})."
            ) from error

    def physics(self) -> tuple[Any, Any] | None:
        inner: Any = self._env.unwrapped
        model, data = getattr(inner, "model", None), getattr(inner, "data", None)
        return (model, data) if hasattr(model, "nq") and hasattr(data, "qpos") else None

    def close(self) -> None:
        self._env.close()

    def _named(self, obs: Any) -> dict[str, np.ndarray]:
        return named_observation(self._env.observation_space, obs)


def make(name: str, settings: Mapping[str, Any]) -> gymnasium.Env[Any, Any]:
    """Make an environment without a time limit: the batch keeps the time.

    Raises:
        InvalidValueError: Gymnasium does not know the name, or refuses the settings.
    """
    if name.startswith(("Adroit", "Fetch", "Hand", "Franka", "PointMaze", "AntMaze")):
        register_robotics(name)
    try:
        return gymnasium.make(name, max_episode_steps=-1, disable_env_checker=True, **settings)
    except (gymnasium.error.Error, TypeError, ImportError) as error:
        raise InvalidValueError(f"gymnasium:{name} cannot be made: {error}") from error


def register_robotics(name: str) -> None:
    """Let Gymnasium know the environments of gymnasium-robotics."""
    try:
        import gymnasium_robotics
    except ImportError as error:
        hint = "Install it: pip install 'aerial-il[robotics]'"
        raise InvalidValueError(f"gymnasium:{name} needs the package gymnasium-robotics. {hint}") from error
    gymnasium.register_envs(gymnasium_robotics)


def observation_spec(space: spaces.Space[Any]) -> ObservationSpec:
    """Return the fields of what an environment shows."""
    parts = space.spaces if isinstance(space, spaces.Dict) else {"observation": space}
    return ObservationSpec(tuple(_field(name, part) for name, part in parts.items()))


def named_observation(space: spaces.Space[Any], obs: Any) -> dict[str, np.ndarray]:
    """Return an observation as ``name -> (*shape)``, copied."""
    if isinstance(space, spaces.Dict):
        return {name: _array(part, obs[name]) for name, part in space.spaces.items()}
    return {"observation": _array(space, obs)}


def action_spec(space: spaces.Space[Any], labels: tuple[str, ...] = ()) -> ActionSpec:
    """Return what an environment takes, as a bounded vector.

    Args:
        labels: names of its elements, used if there are as many.

    Raises:
        InvalidValueError: a space without finite bounds, or of another kind than Box and Discrete.
    """
    if isinstance(space, spaces.Discrete):
        low, high = np.zeros(int(space.n)), np.ones(int(space.n))
    elif isinstance(space, spaces.Box) and np.isfinite([space.low, space.high]).all():
        low, high = space.low.reshape(-1).astype(float), space.high.reshape(-1).astype(float)
    else:
        hint = "Wrap the environment first, e.g. in gymnasium.wrappers.RescaleAction or FlattenObservation."
        raise InvalidValueError(f"Actions are a Box with finite bounds or Discrete, got {space}. {hint}")
    return bounded(low, high, labels)


def bounded(low: np.ndarray, high: np.ndarray, labels: tuple[str, ...]) -> ActionSpec:
    """Return actions between bounds (Da,), named by ``labels`` if there are as many, all different."""
    usable = len(labels) == len(low) and len(set(labels)) == len(labels) and all(labels)
    names = labels if usable else tuple(f"a{i}" for i in range(len(low)))
    return ActionSpec(LEVEL, names, ("",) * len(low), low, high)


def goal_of(env: gymnasium.Env[Any, Any]) -> GoalSpec | None:
    """Return the goal of an environment with Gymnasium's interface for them, or None."""
    space, compute_reward = env.observation_space, getattr(env.unwrapped, "compute_reward", None)
    if compute_reward is None or not isinstance(space, spaces.Dict):
        return None
    if not {"achieved_goal", "desired_goal"} <= space.spaces.keys():
        return None

    def reward(achieved: np.ndarray, desired: np.ndarray) -> np.ndarray:
        found = np.asarray(compute_reward(achieved, desired, {}), float)
        if found.shape == (len(achieved),):
            return found
        return np.array([compute_reward(a, d, {}) for a, d in zip(achieved, desired, strict=True)], float)

    return GoalSpec(("achieved_goal",), ("desired_goal",), reward)


def actuators(inner: Any) -> tuple[str, ...]:
    """Return the names of the actuators of an environment that runs on MuJoCo."""
    model: Any = getattr(inner, "model", None)
    return tuple(model.actuator(i).name for i in range(model.nu)) if hasattr(model, "nu") else ()


def control_dt_s(env: gymnasium.Env[Any, Any]) -> float:
    """Return the time between two actions: what the environment says, else by its frame rate, else 0.05 s."""
    for owner in (env.unwrapped, getattr(env.unwrapped, "model", None)):
        for name in ("dt", "tau"):
            value = getattr(owner, name, None)
            if isinstance(value, float | int) and 0 < value < 10:
                return float(value)
    frames = env.metadata.get("render_fps")
    return 1.0 / frames if frames else DEFAULT_DT_S


def is_image(shape: tuple[int, ...], dtype: Any) -> bool:
    """Return whether an observation is an image, (H, W, 3) of uint8; arrays of other shapes are numbers."""
    return len(shape) == 3 and shape[-1] == 3 and np.dtype(dtype) == np.uint8


def _field(name: str, space: spaces.Space[Any]) -> Field:
    if isinstance(space, spaces.Box):
        pictured = is_image(space.shape, space.dtype)
        group: Group = "image" if pictured else "task" if "goal" in name else "proprio"
        return Field(name, space.shape or (1,), group, "uint8" if pictured else "float64")
    flat = spaces.flatten_space(space)
    if not isinstance(flat, spaces.Box):
        raise InvalidValueError(f"Observation {name!r} is a {space}, which has no vector form.")
    return Field(name, flat.shape, "proprio")


def _array(space: spaces.Space[Any], value: Any) -> np.ndarray:
    if not isinstance(space, spaces.Box):
        return np.array(spaces.flatten(space, value), dtype=float)
    kept = np.uint8 if is_image(space.shape, space.dtype) else float
    return np.array(value, dtype=kept).reshape(space.shape or (1,))
