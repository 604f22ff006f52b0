"""One world as a Gymnasium environment."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from aerial_il.control.actions import ActionLevel
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import ActionSpec, Field, ObservationSpec
from aerial_il.suite.environment import AerialEnvironment
from aerial_il.suite.rendering import CameraRequest
from aerial_il.suite.scenario import Scenario
from aerial_il.suite.timing import CONTROL_DT_S

OF_AN_EVENT = ("ee_error_m", "force_in_band_raw")  # NaN where nothing has been commanded or touched yet
METADATA = {"render_modes": ["rgb_array"], "render_fps": round(1.0 / CONTROL_DT_S)}


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
        robot, task, tier, action, cameras, image_size, seed, controller: as for :func:`aerial_il.load`.
        terminate_on_success: end an episode when its task is done; otherwise only a crash or a lost object ends it.
        render_mode: None or ``rgb_array``. render_camera: which camera. render_size: (height, width), pixels.
    """

    metadata = METADATA

    def __init__(
        self,
        robot: str,
        task: str,
        *,
        tier: str = "calm",
        action: str = "ee_pose",
        cameras: Sequence[str] = (),
        image_size: tuple[int, int] = (240, 320),
        seed: int = 0,
        controller: str = "geometric_observer",
        terminate_on_success: bool = False,
        render_mode: str | None = None,
        render_camera: str = "scene",
        render_size: tuple[int, int] = (240, 320),
    ) -> None:
        scenario = Scenario(robot, task, tier, action, cameras, image_size, controller)
        self.render_mode, self.render_camera = check_rendering(render_mode, render_camera), render_camera
        self.render_size, self.terminate_on_success = render_size, terminate_on_success
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
        terminated = lost or (self.terminate_on_success and info["success"])
        truncated = bool(self.aerial.simulation.steps[0] >= self.aerial.spec.max_steps)
        self._over = terminated or truncated
        return dict(timestep.observation), float(timestep.reward), terminated, truncated, info

    def render(self) -> np.ndarray | None:
        """(H, W, 3) uint8 image of the world as it stands, or None without a render mode."""
        return None if self.render_mode is None else self.aerial.render(self.render_camera, *self.render_size)

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


def check_rendering(mode: str | None, camera: str) -> str | None:
    """Return the render mode if it and the camera exist.

    Raises:
        InvalidValueError: unknown mode. UnknownNameError: unknown camera.
    """
    CameraRequest(camera)
    if mode not in (None, *METADATA["render_modes"]):
        raise InvalidValueError(f"render_mode is None or 'rgb_array', got {mode!r}.")
    return mode


def _box(field: Field) -> spaces.Box:
    dtype = np.dtype(field.dtype)
    low, high = (-np.inf, np.inf)
    if dtype.kind in "iu":
        low, high = np.iinfo(dtype).min, np.iinfo(dtype).max
    return spaces.Box(low, high, field.shape, dtype.type)
