"""Many worlds at once: the environment that collection, training and evaluation run on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import mujoco
import numpy as np

from aerial_il.core.checks import require_integer
from aerial_il.core.contracts import StepResult
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.goals import GoalSpec
from aerial_il.core.seeding import seeds_of
from aerial_il.core.specs import EnvSpec
from aerial_il.suite.cameras import CameraRequest
from aerial_il.suite.engine import ENGINE
from aerial_il.suite.episode.assessment import Assessment
from aerial_il.suite.episode.simulation import Simulation
from aerial_il.suite.physics.physics_batch import STATE, PhysicsBatch
from aerial_il.suite.physics.physics_model import physics_model
from aerial_il.suite.rendering import FrameRenderer
from aerial_il.suite.rig import Rig
from aerial_il.suite.scenario import Scenario
from aerial_il.suite.timing import PHYSICS_DT_S


class BatchEnvironment:
    """n independent worlds of one scenario, shared among threads.

    The environment does not end an episode on success and does not reset by itself: whoever runs it decides, per world.

    Attributes:
        ends_at_success: whether it should. engine: version of what simulates.

    Args:
        scenario: the environment. num_envs: worlds. num_threads: 0 for all cores.
        refinement: parts in which physics steps are taken, to see what their length does.
    """

    engine: str | None = ENGINE

    def __init__(
        self,
        scenario: Scenario,
        num_envs: int,
        num_threads: int = 0,
        *,
        refinement: int = 1,
    ) -> None:
        require_integer("num_envs", num_envs, 1)
        require_integer("num_threads", num_threads, 0)
        self.scenario, self.num_envs = scenario, num_envs
        self.ends_at_success = scenario.horizon is None
        self.model = scenario.compile()
        varied = {name for part in scenario.tier.parts.values() for name in part.varies}
        model = physics_model(self.model, scenario.xml, pairs="geom_friction" not in varied)
        model.opt.timestep = PHYSICS_DT_S / refinement
        worlds = PhysicsBatch.many(model, num_envs)
        self.simulation = Simulation(scenario, worlds, num_threads, refinement=refinement)
        self._shown: mujoco.MjData | None = None  # made when somebody looks
        self._renderers: dict[tuple[int, int], FrameRenderer] = {}
        self._rig = Rig(scenario.camera_requests, num_envs, self._shoot)

    def __repr__(self) -> str:
        return f"BatchEnvironment({self.scenario}, {self.num_envs} worlds)"

    @property
    def spec(self) -> EnvSpec:
        return self.scenario.spec

    @property
    def goal_spec(self) -> GoalSpec | None:
        """The task's goal, where it can be exchanged after the fact."""
        return self.scenario.task.goal

    @property
    def seeds(self) -> np.ndarray:
        """(n,) seeds of the running episodes."""
        return self.simulation.seeds

    @property
    def model_xml(self) -> str:
        """The compiled scene as stand-alone MJCF."""
        return self.scenario.xml

    @property
    def camera_names(self) -> tuple[str, ...]:
        return self.scenario.camera_names

    @property
    def ctrl(self) -> np.ndarray:
        """(n, R + nu) commands of the last physics step: rotors (N), servos (rad), gripper (m)."""
        return self.simulation.ctrl

    @property
    def sim_time(self) -> np.ndarray:
        """(n,) seconds since the start of each episode."""
        return self.simulation.steps * self.spec.control_dt_s

    @property
    def dwell(self) -> np.ndarray:
        """(n,) share, in [0, 1], of the time that success must hold for it has held."""
        return self.simulation.dwell

    def drawn(self, seed: int) -> dict[str, Any]:
        """Disturbances that the tier draws for the episode ``seed``, as plain values."""
        return {**self.simulation.disturbances.drawn(seed), **self.simulation.seen.drawn(seed)}

    def reset(self, seeds: np.ndarray | int | None = None, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Start episodes in all worlds, or in those of ``mask`` (n,) bool.

        Args:
            seeds: (n,) integers, or one integer s for s, s + 1, …; entries outside ``mask`` are ignored. None for those
                that follow the greatest seed of the running episodes.

        Returns:
            Observations of all worlds.
        """
        first = int(self.seeds.max()) + 1
        self.simulation.reset(seeds_of(first if seeds is None else seeds, self.num_envs), mask)
        self._rig.start(self._worlds(mask))
        return self._seen()

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        """Fly one control step of 20 ms; worlds outside ``mask`` (n,) bool stand still.

        Args:
            actions: (n, Da) in the units of ``spec.action``; clipped to its bounds.
        """
        executed = self.simulation.advance(actions, mask)
        assessment = self.simulation.assessment
        self._rig.advance(self._worlds(mask), self.simulation.steps)
        return StepResult(
            obs=self._seen(),
            reward=assessment.reward,
            terminated=assessment.crash | assessment.dropped,
            truncated=assessment.truncated,
            info=info_of(assessment, executed),
        )

    def observe(self) -> dict[str, np.ndarray]:
        """Observations of all worlds as they stand, ``name -> (n, ...)``; images too, whatever their rate and delay."""
        return {**self.simulation.observe(), **self._rig.anew()}

    def get_state(self) -> np.ndarray:
        """(n, S) copies of the full states: physics, controllers, gusts, timers."""
        return self.simulation.worlds.get_state()

    def set_state(self, states: np.ndarray, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Continue from states (n, S) that :meth:`get_state` returned; return the observations.

        No image is part of a state: cameras take one at once, whenever the next is due.
        """
        self.simulation.set_state(states, mask)
        self._rig.start(self._worlds(mask))
        return self._seen()

    def set_state_in_looks(self, states: np.ndarray, seeds: np.ndarray) -> dict[str, np.ndarray]:
        """Continue from states (n, S) with what cameras alone notice as in other episodes, ``seeds`` (n,) int.

        Where nothing of the tier is noticed by cameras alone, this is :meth:`set_state`.
        """
        self.simulation.set_state(states, looks=seeds)
        self._rig.start(self._worlds(None))
        return self._seen()

    def push(self, velocity: np.ndarray, mask: np.ndarray | None = None) -> None:
        """Let the bases gain velocities at once, between two steps, as a blow does; the state holds all of it.

        Args:
            velocity: (n, 3) m/s, world. mask: (n,) bool, the worlds that are pushed; None: all.

        Raises:
            InvalidValueError: the base of this robot stands fixed.
        """
        if not self.scenario.robot.vehicle.base_mobility:
            raise InvalidValueError(f"The base of {self.spec.robot} stands fixed: it cannot be pushed.")
        states = self.get_state()
        states[:, self._base_velocity : self._base_velocity + 3] += velocity
        self.simulation.set_state(states, mask)

    @property
    def _base_velocity(self) -> int:
        """Where the velocity of the base, the first joint, begins in a state."""
        before = int(STATE) & (int(mujoco.mjtState.mjSTATE_QVEL) - 1)
        return mujoco.mj_stateSize(self.model, before)

    def _seen(self) -> dict[str, np.ndarray]:
        """Observations of all worlds as of the last flight, with the images that they show."""
        return {**self.simulation.observations, **self._rig.shown(self.simulation.steps)}

    def _worlds(self, mask: np.ndarray | None) -> Iterable[int]:
        """Numbers of the worlds in ``mask``."""
        return range(self.num_envs) if mask is None else np.flatnonzero(mask).tolist()

    def render(
        self, world: int = 0, camera: str = "scene", height: int = 240, width: int = 320, modality: str = "rgb"
    ) -> np.ndarray:
        """Image of one world: (H, W, 3) uint8 colour, (H, W) float32 depth in m, or (H, W) int32 geom ids."""
        (image,) = self._shoot(world, [self.scenario.camera(camera, modality, (height, width))])
        return image

    def _shoot(self, world: int, requests: Sequence[CameraRequest]) -> list[np.ndarray]:
        """Render images of one world."""
        data, sight, images = self.data(world), self.simulation.sight(world), []
        for request in requests:
            renderer = self._renderers.setdefault(request.size, FrameRenderer(self.model, *request.size))
            images.append(renderer.shoot(data, request, sight))
        return images

    def data(self, world: int) -> mujoco.MjData:
        """One world as an ``MjData`` of :attr:`model`, with all that eyes see; overwritten by the next call."""
        if self._shown is None:
            self._shown = mujoco.MjData(self.model)
        worlds, shown = self.simulation.worlds, self._shown
        state = np.empty(self.spec.state_size)
        mujoco.mj_getState(worlds.model, worlds.data(world), state, STATE)
        mujoco.mj_setState(self.model, shown, state, STATE)
        mujoco.mj_forward(self.model, shown)
        return shown

    def close(self) -> None:
        """Free graphics contexts and end threads."""
        self.simulation.close()
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers.clear()


def info_of(assessment: Assessment, executed: np.ndarray) -> dict[str, np.ndarray]:
    """The measurements of a step by name, each (n, ...)."""
    return {
        "success": assessment.success,
        "crash": assessment.crash,
        "dropped": assessment.dropped,
        "sparse_reward": assessment.success.astype(float),
        "subtasks": assessment.subtasks,
        "ee_error_m": assessment.ee_error,
        "effort": assessment.effort,
        "contacts": assessment.contacts,
        "force_in_band_raw": assessment.force_in_band_raw,
        "executed_action": executed,
    }
