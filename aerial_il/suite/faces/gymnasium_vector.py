"""The batch engine as a Gymnasium vector environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Unpack

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from aerial_il.core.errors import UnknownNameError
from aerial_il.core.seeding import seeds_of
from aerial_il.suite.batch import BatchEnvironment, info_of
from aerial_il.suite.faces.gymnasium_env import METADATA, action_space, observation_space
from aerial_il.suite.faces.options import FaceOptions, read_options


class VectorEnvironment(VectorEnv[dict[str, np.ndarray], np.ndarray, np.ndarray]):
    """n worlds of a cell: ``gymnasium.make_vec(id, num_envs=64, vectorization_mode="vector_entry_point")``.

    A world whose episode ended starts the next one at the following step, whose action it ignores and whose reward is 0
    (``AutoresetMode.NEXT_STEP``); or in the very step that ended it (``SAME_STEP``), where ``info`` has ``final_obs``
    and ``final_info``; or when the caller resets it (``DISABLED``). ``reset(seed=s)`` gives world i the seeds s + i,
    s + i + n, s + i + 2n, …, whenever its episodes end. ``info`` holds the entries of the single environment, each
    (n, ...).

    Attributes:
        aerial: the batch behind it; experts attach to this.
        autoreset_mode: when ended worlds start again.

    Args:
        robot, task, num_envs, seed, num_threads: as for :func:`aerial_il.load_batch`.
        max_episode_steps: truncate episodes earlier than the task does.
        autoreset_mode: see above; Gymnasium's constant, or its name as text.
        options: as for the single environment, see :class:`FaceOptions`.
    """

    def __init__(
        self,
        robot: str,
        task: str,
        *,
        num_envs: int = 1,
        seed: int = 0,
        num_threads: int = 0,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **options: Unpack[FaceOptions],
    ) -> None:
        scenario, self.shown = read_options(robot, task, options)
        self.render_mode = self.shown.render_mode
        self.autoreset_mode = _mode(autoreset_mode)
        self.metadata = {**METADATA, "autoreset_mode": self.autoreset_mode}
        self.num_envs, self.aerial = num_envs, BatchEnvironment(scenario, num_envs, num_threads)
        self.max_episode_steps = min(max_episode_steps or scenario.spec.max_steps, scenario.spec.max_steps)
        self.single_observation_space = observation_space(scenario.spec.observation)
        self.single_action_space = action_space(scenario.spec.action)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._next_seeds = seed + np.arange(num_envs)
        self._over = np.ones(num_envs, bool)

    def reset(
        self, *, seed: int | Sequence[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Start episodes.

        Args:
            seed: s for seeds s, s + 1, …; or one seed per world; or None for the seeds that follow.
            options: ``{"reset_mask": (n,) bool}`` starts only some worlds.
        """
        super().reset(seed=None if seed is None else int(np.ravel(seed)[0]))
        mask = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs)), bool)
        if seed is not None:
            self._next_seeds = np.where(mask, seeds_of(seed, self.num_envs), self._next_seeds)
        observation, executed = self._start(mask), np.zeros((self.num_envs, self.aerial.spec.action.size))
        return observation, self._with_masks(info_of(self.aerial.simulation.assessment, executed), mask)

    def step(
        self, actions: np.ndarray
    ) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Fly one control step of 20 ms in every world, or start its next episode where the last one ended.

        Raises:
            gymnasium.error.ResetNeeded: a world whose episode has ended waits for its reset.
        """
        fresh = self._over
        if fresh.any():
            self._require_next_step()
            self._start(fresh)
        result = self.aerial.step(actions, ~fresh)
        terminated = result.terminated | (self.shown.terminate_on_success & result.info["success"])
        terminated, truncated = terminated & ~fresh, (self.aerial.simulation.steps >= self.max_episode_steps) & ~fresh
        self._over = terminated | truncated
        obs, info = result.obs, self._with_masks(result.info, np.ones(self.num_envs, bool))
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._over.any():
            obs, info = self._started_at_once(obs, info)
        return obs, np.where(fresh, 0.0, result.reward), terminated, truncated, info

    def _require_next_step(self) -> None:
        if self.autoreset_mode is not AutoresetMode.NEXT_STEP:
            waiting = np.flatnonzero(self._over).tolist()
            raise ResetNeeded(f"The episodes of worlds {waiting} are over: call env.reset(), or with a reset_mask.")

    def _started_at_once(
        self, obs: dict[str, np.ndarray], info: dict[str, Any]
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Start the next episodes of the worlds that are over; return what all show then, with the last of those."""
        ended = self._over.copy()
        final = {name: values.copy() for name, values in info.items()}
        last = np.full(self.num_envs, None, object)
        for world in np.flatnonzero(ended):
            last[world] = {name: values[world].copy() for name, values in obs.items()}
        started, nothing = self._start(ended), np.zeros((self.num_envs, self.aerial.spec.action.size))
        fresh = self._with_masks(info_of(self.aerial.simulation.assessment, nothing), ended)
        merged = {name: np.where(_along(ended, v), fresh[name], v) for name, v in final.items()}
        final |= {name: v & ended for name, v in final.items() if name[0] == "_"}
        return started, merged | {"final_obs": last, "_final_obs": ended, "final_info": final, "_final_info": ended}

    def render(self) -> tuple[np.ndarray, ...] | None:
        """Images (H, W, 3) uint8 of all worlds, or None without a render mode."""
        if self.render_mode is None:
            return None
        camera, size = self.shown.render_camera, self.shown.render_size
        return tuple(self.aerial.render(i, camera, *size) for i in range(self.num_envs))

    def close_extras(self, **kwargs: Any) -> None:
        """Free graphics contexts and threads."""
        self.aerial.close()

    def _start(self, mask: np.ndarray) -> dict[str, np.ndarray]:
        """Start the next episodes of the worlds in ``mask`` (n,); return what all worlds show."""
        observation = self.aerial.reset(self._next_seeds, mask)
        self._next_seeds = self._next_seeds + np.where(mask, self.num_envs, 0)
        self._over = self._over & ~mask
        return observation

    def _with_masks(self, info: dict[str, np.ndarray], present: np.ndarray) -> dict[str, Any]:
        """Gymnasium's form of a vector's info: every entry with a mask of the worlds that have it."""
        info = {**info, "is_success": info["success"].copy(), "seed": self.aerial.simulation.seeds}
        has = {f"_{name}": present.copy() for name in info}
        for name in ("ee_error_m", "force_in_band_raw"):
            has[f"_{name}"] &= np.isfinite(info[name])
        return {**info, **has}


def _mode(mode: AutoresetMode | str) -> AutoresetMode:
    known = {name: each for each in AutoresetMode for name in (each.value, each.name)}
    if isinstance(mode, str) and mode not in known:
        raise UnknownNameError("autoreset mode", mode, AutoresetMode.__members__)
    return known[mode] if isinstance(mode, str) else mode


def _along(mask: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return ``mask`` (n,) with as many axes as ``values`` (n, ...)."""
    return mask.reshape(len(mask), *[1] * (values.ndim - 1))
