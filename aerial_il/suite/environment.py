"""One world as a dm_control environment: for teleoperation, inspection and other people's code."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence

import dm_env
import numpy as np
from dm_control.mujoco.wrapper import MjModel
from dm_control.rl import control
from dm_env import specs

from aerial_il.core.specs import EnvSpec
from aerial_il.suite.batch import info_of
from aerial_il.suite.cameras import CameraRequest
from aerial_il.suite.episode.assessment import CRASH, DROPPED, REWARD
from aerial_il.suite.episode.simulation import Simulation
from aerial_il.suite.physics.physics_batch import Physics, PhysicsBatch
from aerial_il.suite.rendering import FrameRenderer
from aerial_il.suite.rig import Rig
from aerial_il.suite.scenario import Scenario
from aerial_il.suite.timing import SUBSTEPS


class SuiteTask(control.Task):
    """dm_control's view of a scenario: it hands every question to the :class:`Simulation` that the batch uses too.

    Args:
        simulation: the scenario's logic for one world, ``physics``. first_seed: of the first episode; a reset takes the
            next.
    """

    def __init__(self, simulation: Simulation, physics: Physics, first_seed: int) -> None:
        self.simulation, self.next_seed, self._physics = simulation, first_seed, physics
        self.executed: np.ndarray | None = None
        self._renderers: dict[tuple[int, int], FrameRenderer] = {}
        self._rig, self._started = Rig(simulation.scenario.camera_requests, 1, self._shoot), False

    def __repr__(self) -> str:
        return f"SuiteTask({self.simulation.scenario})"

    def initialize_episode(self, physics: Physics) -> None:
        self.simulation.reset(np.array([self.next_seed]))
        self.next_seed += 1
        self.executed, self._started = None, False

    def before_step(self, action: np.ndarray, physics: Physics) -> None:
        self.executed = self.simulation.receive(np.asarray(action)[None])

    def after_step(self, physics: Physics) -> None:
        self.simulation.settle()

    def action_spec(self, physics: Physics) -> specs.BoundedArray:
        action = self.simulation.spec.action
        return specs.BoundedArray((action.size,), float, action.low, action.high, name=" ".join(action.labels))

    def observation_spec(self, physics: Physics) -> OrderedDict[str, specs.Array]:
        fields = self.simulation.spec.observation.fields
        return OrderedDict((f.name, specs.Array(f.shape, np.dtype(f.dtype), name=f.name)) for f in fields)

    def get_observation(self, physics: Physics) -> OrderedDict[str, np.ndarray]:
        obs, steps = OrderedDict(self.simulation.observation(0)), self.simulation.steps
        if self._started:
            self._rig.advance([0], steps)
        else:
            self.start_cameras()
        obs.update((name, images[0]) for name, images in self._rig.shown(steps).items())
        return obs

    def start_cameras(self) -> None:
        """Take the first images of an episode, or of the rest of one that is continued from a state."""
        self._rig.start([0])
        self._started = True

    def shoot(self, request: CameraRequest) -> np.ndarray:
        """Render one image of the world."""
        physics = self._physics
        renderer = self._renderers.setdefault(request.size, FrameRenderer(physics.model.ptr, *request.size))
        return renderer.shoot(physics.data.ptr, request, self.simulation.sight(0))

    def _shoot(self, _: int, requests: Sequence[CameraRequest]) -> list[np.ndarray]:
        return [self.shoot(request) for request in requests]

    def close(self) -> None:
        """Free graphics contexts."""
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers.clear()

    def get_reward(self, physics: Physics) -> float:
        return self.simulation.verdict(0, REWARD)

    def get_termination(self, physics: Physics) -> float | None:
        verdict = self.simulation.verdict
        return 0.0 if verdict(0, CRASH) or verdict(0, DROPPED) else None


class AerialEnvironment(control.Environment):
    """A real ``dm_control.rl.control.Environment`` over one world.

    Each ``reset`` starts the next seed; ``reset(seed=…)`` chooses one.

    Args:
        scenario: the environment. seed: seed of the first episode.
    """

    def __init__(self, scenario: Scenario, seed: int = 0) -> None:
        self.scenario = scenario
        physics = Physics.from_model(MjModel(scenario.compile()))
        self.simulation = Simulation(scenario, PhysicsBatch.of(physics))
        physics.fly = self.simulation.fly
        self._suite_task = SuiteTask(self.simulation, physics, seed)
        super().__init__(physics, self._suite_task, time_limit=scenario.task.time_limit_s, n_sub_steps=SUBSTEPS)

    def __repr__(self) -> str:
        return f"AerialEnvironment({self.scenario})"

    @property
    def spec(self) -> EnvSpec:
        """Specification of observations and actions."""
        return self.scenario.spec

    @property
    def model_xml(self) -> str:
        """The compiled scene as stand-alone MJCF."""
        return self.scenario.xml

    @property
    def camera_names(self) -> tuple[str, ...]:
        return self.scenario.camera_names

    @property
    def info(self) -> dict[str, np.ndarray]:
        """Measurements of the last step by name, as in the batch's ``StepResult.info``, without the world axis."""
        task = self._suite_task
        executed = np.zeros((1, self.spec.action.size)) if task.executed is None else task.executed
        return {name: value[0] for name, value in info_of(self.simulation.assessment, executed).items()}

    def reset(self, seed: int | None = None) -> dm_env.TimeStep:
        """Start the next episode, or the one of ``seed``."""
        if seed is not None:
            self._suite_task.next_seed = seed
        return super().reset()

    def step(self, action: np.ndarray) -> dm_env.TimeStep:
        """Fly one control step of 20 ms; after the last step of an episode, start the next instead."""
        return super().step(action)

    def get_state(self) -> np.ndarray:
        """(1, S) copy of the full state: physics, controller, gusts, timers."""
        return self.simulation.worlds.get_state()

    def set_state(self, states: np.ndarray) -> None:
        """Continue from a state (1, S) that :meth:`get_state` returned, here or in a batch."""
        self.simulation.set_state(states)
        self._suite_task.start_cameras()
        self._step_count, self._reset_next_step = int(self.simulation.steps[0]), False

    def render(self, camera: str = "scene", height: int = 240, width: int = 320, modality: str = "rgb") -> np.ndarray:
        """Image (H, W, 3) uint8, depth (H, W) float32 in m, or geom ids (H, W) int32."""
        return self._suite_task.shoot(self.scenario.camera(camera, modality, (height, width)))

    def close(self) -> None:
        """Free graphics contexts."""
        self._suite_task.close()
        super().close()
