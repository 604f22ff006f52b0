"""One episode's logic for n worlds: start, fly, observe, judge. Both environments are thin faces of it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NoReturn

import mujoco
import numpy as np

from aerial_il.control.actions import ActionLevel
from aerial_il.control.vehicle import Gains
from aerial_il.core.arrays import length
from aerial_il.core.errors import InvalidValueError, SimulationDivergedError
from aerial_il.core.seeding import episode_rng
from aerial_il.suite import memory as mem
from aerial_il.suite import tiers
from aerial_il.suite.crew import Crew
from aerial_il.suite.flight_loop import fly, receive_actions
from aerial_il.suite.observations import observe_robot
from aerial_il.suite.scenario import Scenario
from aerial_il.suite.scene import CONTROL_DT_S, PHYSICS_DT_S, SUBSTEPS
from aerial_il.suite.view import View
from aerial_il.suite.worlds import STATE, PhysicsError, Worlds

FENCE_M = 4.0  # a base farther than this from the origin has flown away
LARGEST_SEED = 2**53
FLIGHT = slice(mem.SEED, mem.STEP + 1)  # what identifies a moment: seed first, step last
STATE_OFFSET = int(STATE) & (int(mujoco.mjtState.mjSTATE_USERDATA) - 1)  # parts of a state that precede userdata


@dataclass(frozen=True)
class Judgement:
    """How n worlds stand after a step. Each array is (n,), ``subtasks`` is (n, K).

    Attributes:
        reward: dense, in [0, 1]. success: the condition has held for its dwell. crash: the base struck something,
            turned over or flew away. truncated: the time is up. subtasks: flags at this instant. ee_error: distance
            between commanded and actual tool position, m (NaN where the action level commands none). effort: mean
            squared rotor use, in [0, 1]. contacts: robot parts, gripper aside, that touch something.
    """

    reward: np.ndarray
    success: np.ndarray
    crash: np.ndarray
    truncated: np.ndarray
    subtasks: np.ndarray
    ee_error: np.ndarray
    effort: np.ndarray
    contacts: np.ndarray


class Simulation:
    """Fly n worlds of one scenario.

    Args:
        scenario: what is flown. worlds: the simulator. gains: controller tuning.
        num_threads: threads for the controllers, 0 for all cores.
    """

    def __init__(self, scenario: Scenario, worlds: Worlds, gains: Gains | None = None, num_threads: int = 0) -> None:
        self.scenario, self.worlds = scenario, worlds
        self.robot, self.task, self.spec = scenario.robot, scenario.task, scenario.spec
        self.view = View(worlds, self.robot)
        self.gains = gains or Gains()
        self._vehicle, self._air, self._level = self.robot.vehicle, scenario.air, int(scenario.level)
        self._sensors = tiers.get(scenario.tier_name).sensors
        self._act, self._ctrl, self._xfrc = (worlds.bind(k) for k in ("act", "ctrl", "xfrc_applied"))
        self._userdata = worlds.bind("userdata")
        self._dwell_steps = max(1, round(self.task.dwell_s / CONTROL_DT_S))
        self._crew = Crew(worlds.n, num_threads)
        self._everyone = np.ones(worlds.n, bool)
        self._mask, self._ids = self._everyone, None
        self._actions = np.zeros((worlds.n, self.spec.action.size))
        self._commanded = np.full((worlds.n, 3), np.nan)
        self._flights = self._userdata[:, FLIGHT].copy()

    @property
    def n(self) -> int:
        return self.worlds.n

    def reset(self, seeds: np.ndarray, mask: np.ndarray | None = None) -> None:
        """Start episodes.

        Args:
            seeds: (n,) non-negative integers below 2**53. mask: (n,) bool, the worlds to start; None: all.

        Raises:
            InvalidValueError: a seed outside its range.
        """
        mask, ids = self._select(mask)
        for i in np.flatnonzero(mask):
            if not 0 <= int(seeds[i]) < LARGEST_SEED:
                raise InvalidValueError(f"Seeds are integers from 0 to 2**53 - 1, got {seeds[i]}.")
        self.worlds.clear(ids)
        for i in np.flatnonzero(mask):
            seed = int(seeds[i])
            self._userdata[i, mem.SEED] = seed
            rng = episode_rng(self.spec.robot, self.spec.task, self.spec.tier, seed)
            self._userdata[i, mem.NOISE] = rng.standard_normal(12)
            if self._air.gust_force > 0.0:
                self._userdata[i, mem.GUST] = np.tile(rng.standard_normal(6), 2)
            self.task.start(self.view, i, rng)
        self.worlds.forward(ids)
        self._commanded[mask] = np.nan

    def advance(self, actions: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
        """Fly one control step (five physics steps).

        Args:
            actions: (n, Da); values outside the bounds are clipped. mask: (n,) bool, the worlds that move.

        Returns:
            (n, Da) actions as executed.

        Raises:
            InvalidValueError: wrong shape.
            SimulationDivergedError: a non-finite action or state.
        """
        executed = self.receive(actions, mask)
        with self.physics_errors():
            for _ in range(SUBSTEPS):
                self.control()
                self.worlds.step(self._ids)
        self.settle()
        return executed

    def receive(self, actions: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
        """First part of :meth:`advance`: take the actions and hand them to the controllers."""
        self._mask, self._ids = self._select(mask)
        self._actions = self._checked(actions, self._mask)
        self._flights = self._userdata[:, FLIGHT].copy()
        receive_actions(
            self._vehicle,
            self.gains,
            self._level,
            self._actions,
            self._mask,
            self.view.qpos,
            self._userdata,
            CONTROL_DT_S,
        )
        return self._actions

    def control(self) -> None:
        """Before each physics step: run the controllers and the air of the moving worlds."""
        self._crew.run(self._fly)

    def _fly(self, part: slice) -> None:
        view = self.view
        fly(
            self._vehicle, self.gains, self._air, self._sensors, self._level, self._actions[part], self._mask[part],
            view.qpos[part], view.qvel[part], self._act[part], self._ctrl[part], self._xfrc[part], self._userdata[part],
            self.robot.gripper.stroke, PHYSICS_DT_S,
        )  # fmt: skip

    def settle(self) -> None:
        """Last part of :meth:`advance`: count the step, check the state, update dwell and crash flags."""
        mask = self._mask
        self._check_physics(mask)
        self._userdata[mask, mem.STEP] += 1.0
        if self._level == ActionLevel.EE_POSE:
            self._commanded[mask] = self._actions[mask, :3]
        self._update_flags(mask)

    def set_state(self, states: np.ndarray, mask: np.ndarray | None = None) -> None:
        """Continue from states (n, S) that ``worlds.get_state`` returned; ``mask``: (n,) bool, the worlds to set.

        Raises:
            InvalidValueError: wrong shape.
            SimulationDivergedError: a state in which MuJoCo finds NaN, infinity or huge values.
        """
        mask, ids = self._select(mask)
        states = np.asarray(states, float)
        if states.shape != (self.n, self.spec.state_size):
            raise InvalidValueError(
                f"States have shape {(self.n, self.spec.state_size)} for this scenario, got {states.shape}."
            )
        userdata = states[:, mujoco.mj_stateSize(self.worlds.model, STATE_OFFSET) :]
        self._flights = np.nan_to_num(userdata[:, FLIGHT])
        bad = mask & ~np.isfinite(states).all(axis=1)
        if bad.any():
            self._diverged(bad, "State to continue from is not finite")
        with self.physics_errors():
            self.worlds.set_state(states, ids)
        self._check_physics(mask)
        self._commanded[mask] = np.nan

    @contextmanager
    def physics_errors(self) -> Iterator[None]:
        """Name seed and step where MuJoCo gives up on a world while it flies."""
        try:
            yield
        except PhysicsError as error:
            self._diverged(np.arange(self.n) == error.world, str(error))

    def observe(self) -> dict[str, np.ndarray]:
        """State observations of all worlds, ``name -> (n, ...)``."""
        return {**observe_robot(self.view), **self.task.observe(self.view)}

    def judge(self) -> Judgement:
        """Rewards, flags and measurements of all worlds at this instant."""
        userdata, view = self._userdata, self.view
        success = userdata[:, mem.DWELL] >= self._dwell_steps
        use = self._act[:, : self.robot.num_rotors] / self._vehicle.rotor_max
        return Judgement(
            reward=np.where(success, 1.0, self.task.reward(view)),
            success=success,
            crash=userdata[:, mem.CRASHED] > 0.0,
            truncated=userdata[:, mem.STEP] >= self.spec.max_steps,
            subtasks=self.task.progress(view),
            ee_error=length(self._commanded - view.tool_pos),
            effort=np.mean(use * use, axis=1),
            contacts=view.unwanted_contacts,
        )

    def close(self) -> None:
        """End the controllers' threads."""
        self._crew.close()

    @property
    def steps(self) -> np.ndarray:
        """(n,) control steps since the start of each episode."""
        return self._userdata[:, mem.STEP].astype(int)

    @property
    def seeds(self) -> np.ndarray:
        """(n,) seeds of the episodes."""
        return self._userdata[:, mem.SEED].astype(int)

    @property
    def ctrl(self) -> np.ndarray:
        """(n, nu) actuator commands of the last physics step: rotors (N), servos (rad), gripper (m)."""
        return self._ctrl

    def _select(self, mask: np.ndarray | None) -> tuple[np.ndarray, np.ndarray | None]:
        if mask is None:
            return self._everyone, None
        mask = np.asarray(mask, bool)
        if mask.shape != (self.n,):
            raise InvalidValueError(f"mask has one entry per world, ({self.n},), got {mask.shape}.")
        return mask, (None if mask.all() else np.flatnonzero(mask).astype(np.int32))

    def _checked(self, actions: np.ndarray, mask: np.ndarray) -> np.ndarray:
        actions = np.array(actions, float, ndmin=2)
        if actions.shape != (self.n, self.spec.action.size):
            raise InvalidValueError(
                f"{self.spec.action.level} on {self.spec.robot} takes actions of shape "
                f"{(self.n, self.spec.action.size)} ({', '.join(self.spec.action.labels)}), got {actions.shape}."
            )
        bad = mask & ~np.isfinite(actions).all(axis=1)
        if bad.any():
            self._flights = self._userdata[:, FLIGHT].copy()
            self._diverged(bad, "Action is not finite")
        actions[~mask] = 0.0
        return self.spec.action.clip(actions)

    def _check_physics(self, mask: np.ndarray) -> None:
        """Refuse worlds that MuJoCo warned about: it goes on after a warning, from the start or without a contact."""
        warned = mask & self.worlds.warned()
        if warned.any():
            self._diverged(warned, self.worlds.warning(int(np.flatnonzero(warned)[0])))

    def _diverged(self, bad: np.ndarray, what: str) -> NoReturn:
        seed, *_, step = self._flights[np.flatnonzero(bad)[0]]
        raise SimulationDivergedError(what.rstrip(". "), seed=int(seed), step=int(step))

    def _update_flags(self, mask: np.ndarray) -> None:
        """Count how long the task has been solved and notice crashes; both live in the simulator's state."""
        view, userdata = self.view, self._userdata
        upside_down = view.base_mat[:, 8] < 0.17  # tilted beyond 80°
        away = length(view.base_pos) > FENCE_M
        crash = mask & (view.base_touched | upside_down | away)
        userdata[crash, mem.CRASHED] = 1.0
        held = self.task.solved(view) & (userdata[:, mem.CRASHED] == 0.0)
        userdata[mask, mem.DWELL] = np.where(held, userdata[:, mem.DWELL] + 1.0, 0.0)[mask]
