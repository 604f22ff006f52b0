"""One world as a Gymnasium environment."""

from __future__ import annotations

import math
from typing import Any, Unpack

import gymnasium
import numpy as np
from gymnasium import spaces

from aerial_il.control.actions import ActionLevel
from aerial_il.core.specs import ActionSpec, Field, ObservationSpec
from aerial_il.suite.environment import AerialEnvironment
from aerial_il.suite.faces.options import RENDER_MODES, FaceOptions, read_options
from aerial_il.suite.scenario import Scenario
from aerial_il.suite.timing import CONTROL_DT_S

OF_AN_EVENT = ("ee_error_m", "force_in_band_raw")  # NaN where nothing has been commanded or touched yet
METADATA = {"render_modes": list(RENDER_MODES), "render_fps": round(1.0 / CONTROL_DT_S)}


class SingleEnv(gymnasium.Env[Any, np.ndarray]):
    """One world of a cell: ``gymnasium.make("aerial_il/pick_place-ua_quad_arm4-v0", tier="gusts")``.

    Observations are a dictionary of float64 fields in SI units, with images beside them where cameras are asked for.
    Actions are in SI units too; float32 ones are taken as they are, and values outside the bounds are clipped.

    ``reset(seed=s)`` starts the episode with seed s, further resets take the seeds that follow. ``info`` holds
    ``seed``, ``success``, ``is_success``, ``crash``, ``dropped``, ``subtasks`` (K,) named by
    ``env.unwrapped.aerial.spec.subtasks``, ``sparse_reward``, ``effort``, ``contacts``, ``executed_action``,
    ``ee_error_m`` at levels that command a tool position, and ``force_in_band_raw`` in tasks that ask for a force: the
    same keys from the reset on, where nothing has been commanded or touched yet zero.

    Attributes:
        aerial: the dm_control environment behind it; experts attach to this.

    Args:
        robot, task, seed: as for :func:`aerial_il.load`.
        options: ``tier``, ``action``, ``cameras``, ``image_size``, ``controller``, ``terminate_on_success``,
            ``render_mode``, ``render_camera``, ``render_size``: see :class:`FaceOptions`.
    """

    metadata = METADATA

    def __init__(
        self,
        robot: str,
        task: str,
        *,
        seed: int = 0,
        **options: Unpack[FaceOptions],
    ) -> None:
        scenario, self.shown = read_options(robot, task, options)
        self.render_mode = self.shown.render_mode
        self.aerial = AerialEnvironment(scenario, seed)
        self.observation_space = observation_space(scenario.spec.observation)
        self.action_space = action_space(scenario.spec.action)
        self._absent = _absent(scenario)
        self._over = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Start the episode of ``seed``, or the next one; ``options`` are not used."""
        super().reset(seed=seed)
        observation = self.aerial.reset(seed).observation
        self._over = False
        return dict(observation), self._info()

    def step(self, action: np.ndarray) -> tuple[dict[str, np.ndarray], float, bool, bool, dict[str, Any]]:
        """Fly one control step of 20 ms.

        Raises:
            gymnasium.error.ResetNeeded: no episode is running.
        """
        if self._over:
            raise gymnasium.error.ResetNeeded("No episode is running; call env.reset() first.")
        timestep = self.aerial.step(action)
        info = self._info()
        lost = info["crash"] or info["dropped"]
        terminated = lost or (self.shown.terminate_on_success and info["success"])
        truncated = bool(self.aerial.simulation.steps[0] >= self.aerial.spec.max_steps)
        self._over = terminated or truncated
        return dict(timestep.observation), float(timestep.reward), terminated, truncated, info

    def render(self) -> np.ndarray | None:
        """(H, W, 3) uint8 image of the world as it stands, or None without a render mode."""
        camera, size = self.shown.render_camera, self.shown.render_size
        return None if self.render_mode is None else self.aerial.render(camera, *size)

    def close(self) -> None:
        """Free graphics contexts."""
        self.aerial.close()

    def _info(self) -> dict[str, Any]:
        measured = ((name, v) for name, v in self.aerial.info.items() if name not in self._absent)
        info: dict[str, Any] = {name: v if v.ndim else v.item() for name, v in measured}
        info.update((name, 0.0) for name in OF_AN_EVENT if math.isnan(info.get(name, 0.0)))
        return {**info, "is_success": info["success"], "seed": int(self.aerial.simulation.seeds[0])}


def _absent(scenario: Scenario) -> set[str]:
    """Names of measurements that do not exist in a scenario."""
    commands_tool = scenario.level in (ActionLevel.EE_POSE, ActionLevel.EE_DELTA)
    there = {"ee_error_m": commands_tool, "force_in_band_raw": scenario.task.asks_for_force}
    return {name for name, exists in there.items() if not exists}


def observation_space(spec: ObservationSpec) -> spaces.Dict:
    """Space of one world's observations; state fields are unbounded."""
    return spaces.Dict({field.name: _box(field) for field in spec.fields})


def action_space(spec: ActionSpec) -> spaces.Box:
    """Space of one world's actions, in SI units."""
    return spaces.Box(spec.low, spec.high, dtype=np.float64)


def _box(field: Field) -> spaces.Box:
    dtype = np.dtype(field.dtype)
    low, high = (-np.inf, np.inf)
    if dtype.kind in "iu":
        low, high = np.iinfo(dtype).min, np.iinfo(dtype).max
    return spaces.Box(low, high, field.shape, dtype.type)
