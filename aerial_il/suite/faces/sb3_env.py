"""Our worlds as a vectorised environment of Stable-Baselines3, on the batch engine rather than in processes::

    from aerial_il.suite.faces.sb3_env import Sb3Env
    PPO("MultiInputPolicy", Sb3Env("fa_hexa_arm4", "reach", num_envs=16)).learn(100_000)

Stable-Baselines3 is an extra: ``pip install 'aerial-il[sb3]'``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv

from aerial_il.suite.faces.gymnasium_vector import VectorEnvironment

OF_EPISODE = ("final_obs", "final_info", "_final_obs", "_final_info")


class Sb3Env(VecEnv):
    """n worlds of a cell; observations are a dictionary of (n, ...), actions SI units within the bounds.

    A world starts again in the step that ends its episode. ``infos[i]`` then has ``terminal_observation`` and
    ``TimeLimit.truncated``; ``is_success`` and the other entries are those of the step that was flown.

    Attributes:
        worlds: the Gymnasium vector environment behind it.

    Args:
        robot, task, options: as for :class:`VectorEnvironment`.
    """

    def __init__(self, robot: str, task: str, *, num_envs: int = 1, **options: Any) -> None:
        self.worlds = VectorEnvironment(
            robot, task, num_envs=num_envs, autoreset_mode=AutoresetMode.SAME_STEP, **options
        )
        self.render_mode = self.worlds.render_mode
        self._actions = np.zeros((num_envs, self.worlds.aerial.spec.action.size))
        super().__init__(num_envs, self.worlds.single_observation_space, self.worlds.single_action_space)

    def reset(self) -> dict[str, np.ndarray]:
        """Start the episodes of the seeds that were set, or of those that follow."""
        seed = None if None in self._seeds else [int(s) for s in self._seeds if s is not None]
        obs, info = self.worlds.reset(seed=seed)
        self.reset_infos = self._infos(info)
        self._reset_seeds()
        self._reset_options()
        return obs

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions (n, Da) of the next step."""
        self._actions = actions

    def step_wait(self) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Fly the step: observations, rewards (n,), whether an episode ended (n,), and an info for each world."""
        obs, reward, terminated, truncated, info = self.worlds.step(self._actions)
        over = terminated | truncated
        infos = self._infos(info)
        for world in np.flatnonzero(over):
            (flown,) = self._infos(info["final_info"], [world])
            flown["terminal_observation"] = info["final_obs"][world]
            flown["TimeLimit.truncated"] = bool(truncated[world] and not terminated[world])
            infos[world] = flown
        return obs, reward.astype(np.float32), over, infos

    def close(self) -> None:
        """Free graphics contexts and threads."""
        self.worlds.close()

    def get_images(self) -> Sequence[np.ndarray | None]:
        """Images (H, W, 3) of all worlds; None without a render mode."""
        return self.worlds.render() or [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The attribute that all worlds share, once for each."""
        owner = self if attr_name == "render_mode" else self.worlds
        return [getattr(owner, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute that all worlds share."""
        setattr(self.worlds, attr_name, value)

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Call a method, over all worlds, once; its answer for each."""
        answer = getattr(self.worlds, method_name)(*method_args, **method_kwargs)
        return [answer for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """No world stands in a wrapper of its own."""
        return [False for _ in self._get_indices(indices)]

    def _infos(self, info: dict[str, Any], worlds: Iterable[int] | None = None) -> list[dict[str, Any]]:
        """Return a dictionary for each of ``worlds``, with its entries of an info."""
        names = [name for name in info if name[0] != "_" and name not in OF_EPISODE]
        chosen = range(self.num_envs) if worlds is None else worlds
        return [{name: _plain(info[name][world]) for name in names if info[f"_{name}"][world]} for world in chosen]


def _plain(value: Any) -> Any:
    return value.copy() if isinstance(value, np.ndarray) and value.ndim else value.item()
