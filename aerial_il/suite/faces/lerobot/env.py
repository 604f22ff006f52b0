"""Our cells as an environment of lerobot, for its own evaluator and trainer::

    lerobot-eval --env.discover_packages_path=aerial_il.suite.faces.lerobot --env.type=aerial_il \\
        --env.task=reach --env.robot=fa_hexa_arm4 --policy.path=PATH --eval.n_episodes=50 --seed=10000

With the package of ``plugins/lerobot_env_aerial_il`` installed, lerobot finds it by itself.

Observations and actions are those of the datasets that ``aerial-il convert`` writes: proprioception as the state, the
task's fields as the environment's state, colour cameras as images, actions in SI units. An episode ends as in our own
evaluation: at the first success, a crash, the loss of its object or when its time is up; equal seeds are equal
episodes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv
from lerobot.configs import FeatureType, PolicyFeature
from lerobot.envs.configs import EnvConfig
from lerobot.envs.utils import freeze_after_episode_end

from aerial_il.core import lerobot_names
from aerial_il.core.rendering import can_render
from aerial_il.core.specs import EnvSpec, Group, camera_name
from aerial_il.suite.faces.gymnasium_env import SingleEnv
from aerial_il.suite.faces.gymnasium_ids import gymnasium_id
from aerial_il.suite.scenario import Scenario

ACTION, STATE, ENVIRONMENT, IMAGES = "action", "agent_pos", "environment_state", "pixels"
FEATURE_OF = {ACTION: lerobot_names.ACTION, STATE: lerobot_names.STATE, ENVIRONMENT: lerobot_names.ENVIRONMENT}
VECTORS: tuple[tuple[str, Group], ...] = ((STATE, "proprio"), (ENVIRONMENT, "task"))
FILM_SIZE = (120, 160)  # of the films that lerobot makes of each evaluation


@EnvConfig.register_subclass("aerial_il")
@dataclass
class AerialEnvConfig(EnvConfig):
    """A cell, as ``--env.NAME=...`` of lerobot's commands.

    Attributes:
        task, robot, tier, action, controller: registry names, as for :func:`aerial_il.load`.
        cameras: whose colour images are observed. image_height, image_width: their size, pixels.
    """

    task: str | None = "reach"
    fps: int = 50
    robot: str = "fa_hexa_arm4"
    tier: str = "calm"
    action: str = "ee_pose"
    controller: str = "geometric_observer"
    cameras: list[str] = field(default_factory=list)
    image_height: int = 64
    image_width: int = 64

    def __post_init__(self) -> None:
        spec = Scenario(robot_name=self.robot, task_name=str(self.task), **self._options()).spec
        self.fps = round(1 / spec.control_dt_s)
        sizes = {STATE: _size(spec, "proprio"), ENVIRONMENT: _size(spec, "task")}
        self.features = {ACTION: PolicyFeature(FeatureType.ACTION, (spec.action.size,))}
        self.features_map = dict(FEATURE_OF)
        for name, kind in ((STATE, FeatureType.STATE), (ENVIRONMENT, FeatureType.ENV)):
            if sizes[name]:
                self.features[name] = PolicyFeature(kind, (sizes[name],))
        for image in spec.observation.of_group("image"):
            camera = camera_name(image.name)
            self.features[f"{IMAGES}/{camera}"] = PolicyFeature(FeatureType.VISUAL, image.shape)
            self.features_map[f"{IMAGES}/{camera}"] = lerobot_names.IMAGES + camera

    @property
    def package_name(self) -> str:
        return "aerial_il"

    @property
    def gym_id(self) -> str:
        return gymnasium_id(self.robot, str(self.task))

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        film = {"render_mode": "rgb_array" if can_render() else None, "render_size": FILM_SIZE}
        return {**self._options("tier", "action"), **film, "terminate_on_success": True}

    def create_envs(self, n_envs: int, use_async_envs: bool = False) -> dict[str, dict[int, VectorEnv]]:
        """Return ``{"aerial_il": {0: n_envs worlds}}``, each frozen once its episode has ended."""
        make = freeze_after_episode_end(partial(make_face, self.robot, str(self.task), self.gym_kwargs))
        if use_async_envs and n_envs > 1:
            vector = AsyncVectorEnv([make] * n_envs, context="forkserver", autoreset_mode=AutoresetMode.SAME_STEP)
        else:
            vector = SyncVectorEnv([make] * n_envs, autoreset_mode=AutoresetMode.SAME_STEP)
        return {self.type: {0: vector}}

    def _options(self, tier: str = "tier_name", action: str = "action") -> dict[str, Any]:
        size = (self.image_height, self.image_width)
        cell = {tier: self.tier, action: self.action, "controller": self.controller}
        return {**cell, "cameras": tuple(self.cameras), "image_size": size}


def make_face(robot: str, task: str, options: dict[str, Any]) -> LerobotFace:
    """Return one world as lerobot wants it."""
    return LerobotFace(SingleEnv(robot, task, **options))


class LerobotFace(gymnasium.ObservationWrapper[Any, np.ndarray, Any]):
    """One world whose observations and attributes bear the names that lerobot looks for.

    Attributes:
        task, task_description: the instruction in one English sentence.
    """

    def __init__(self, env: SingleEnv) -> None:
        super().__init__(env)
        self.spec_of_env: EnvSpec = env.aerial.spec
        self.task = self.task_description = self.spec_of_env.instruction
        self._max_episode_steps = self.spec_of_env.max_steps
        self.observation_space = _space(self.observation(env.observation_space.sample()))

    def observation(self, observation: dict[str, np.ndarray]) -> dict[str, Any]:
        """Join the fields to vectors, and gather the images by camera."""
        fields = self.spec_of_env.observation
        seen: dict[str, Any] = {}
        for name, group in VECTORS:
            if members := fields.of_group(group):
                seen[name] = fields.flatten(observation, [f.name for f in members])
        images = {camera_name(f.name): observation[f.name] for f in fields.of_group("image")}
        return {**seen, IMAGES: images} if images else seen

    def step(self, action: np.ndarray) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        obs, reward, terminated, truncated, info = super().step(action)
        info["is_success"] = bool(info["success"] and not info["crash"])
        return obs, float(reward), terminated, truncated, info

    def render(self) -> Any:
        """Return an image for lerobot's film, black where nothing can be drawn."""
        drawn = self.env.render()
        return np.zeros((*FILM_SIZE, 3), np.uint8) if drawn is None else drawn


def _size(spec: EnvSpec, group: Any) -> int:
    return sum(f.size for f in spec.observation.of_group(group))


def _space(sample: dict[str, Any]) -> spaces.Dict:
    def box(value: Any) -> spaces.Space:
        if isinstance(value, dict):
            return _space(value)
        low, high = (0, 255) if value.dtype == np.uint8 else (-np.inf, np.inf)
        return spaces.Box(low, high, value.shape, value.dtype.type)

    return spaces.Dict({name: box(value) for name, value in sample.items()})
