"""One episode's logic for n worlds: start, fly, observe, judge. Both environments are thin faces of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import NoReturn

import mujoco
import numpy as np

from aerial_il.control import memory as controller_memory
from aerial_il.control.actions import ActionLevel
from aerial_il.control.laws import Law
from aerial_il.control.scratch import SCRATCH
from aerial_il.control.vehicle import Gains, alone, record_of
from aerial_il.core.arrays import length
from aerial_il.core.errors import InvalidValueError, SimulationDivergedError
from aerial_il.core.seeding import episode_rng
from aerial_il.suite import memory as mem
from aerial_il.suite.crew import Crew
from aerial_il.suite.disturbances import Disturbances
from aerial_il.suite.flight_loop import Flight, fly
from aerial_il.suite.observations import observe_robot, robot_fields
from aerial_il.suite.scenario import Scenario
from aerial_il.suite.scene import CONTROL_DT_S, PHYSICS_DT_S, SUBSTEPS
from aerial_il.suite.view import View
from aerial_il.suite.worlds import STATE, Worlds

LARGEST_SEED = 2**53
TARGET = slice(controller_memory.TARGET_POS, controller_memory.TARGET_POS + 3)  # the tool position last commanded
FLIGHT = slice(mem.SEED, mem.STEP + 1)  # what identifies a moment: seed first, step last
STATE_OFFSET = int(STATE) & (int(mujoco.mjtState.mjSTATE_USERDATA) - 1)  # parts of a state that precede userdata


@dataclass(frozen=True)
class Judgement:
    """How n worlds stand after a step. Each array is (n,), ``subtasks`` is (n, K).

    Attributes:
        reward: dense, in [0, 1]. success: the condition has held for its dwell. crash: the base struck something,
            turned over or flew away. dropped: the task's object is out of reach for good. truncated: the time is up.
        subtasks: flags at this instant. ee_error: distance between commanded and actual tool position, m (NaN where the
            action level commands none). effort: mean squared rotor use, in [0, 1].
        contacts: robot parts, gripper aside, that touch something. force_in_band_raw: share of the time in contact in
            which the force before the sensor's filter was as the task asks (NaN without contact, or a force asked for).
    """

    reward: np.ndarray
    success: np.ndarray
    crash: np.ndarray
    dropped: np.ndarray
    truncated: np.ndarray
    subtasks: np.ndarray
    ee_error: np.ndarray
    effort: np.ndarray
    contacts: np.ndarray
    force_in_band_raw: np.ndarray


class Simulation:
    """Fly n worlds of one scenario.

    Args:
        scenario: what is flown. worlds: the simulator. gains: controller tuning, None for the scenario's flight law.
        num_threads: threads for the controllers, 0 for all cores.
    """

    def __init__(self, scenario: Scenario, worlds: Worlds, gains: Gains | None = None, num_threads: int = 0) -> None:
        self.scenario, self.worlds = scenario, worlds
        self.robot, self.task, self.spec = scenario.robot, scenario.task, scenario.spec
        self.view = View(worlds, self.robot)
        self.gains = (gains or scenario.law.gains).fitted(self.robot.vehicle)
        self.disturbances = Disturbances(scenario, self.view)
        self._act, self._ctrl, self._userdata = (worlds.bind(name) for name in ("act", "ctrl", "userdata"))
        self._flight = Flight(
            vehicle=alone(Law(self.gains.law).record(self.robot.vehicle)),
            gains=alone(record_of(self.gains)),
            air=alone(record_of(scenario.air)),
            sensors=alone(record_of(scenario.tier.sensors)),
            level=int(scenario.level),
            force_addresses=np.array([self.view.address(name) for name in self.task.force_sensors], np.int64),
            base_site=self.view.base_site,
            base_contact=self.view.address("contact_base"),
            dt=PHYSICS_DT_S,
            interval=CONTROL_DT_S,
            substeps=SUBSTEPS,
        )
        self._proprioception = tuple(field.name for field in robot_fields(self.robot))
        self._dwell_steps = max(1, round(self.task.dwell_s / CONTROL_DT_S))
        self._crew = Crew(worlds.n, num_threads)
        self._everyone = np.ones(worlds.n, bool)
        self._mask, self._fresh = self._everyone, False
        self._actions = self._arriving = np.zeros((worlds.n, self.spec.action.size))
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
        mask = self._select(mask)
        _check_seeds(seeds[mask])
        self.worlds.clear(mask)
        for i in np.flatnonzero(mask):
            seed = int(seeds[i])
            self._userdata[i, mem.SEED] = seed
            self.disturbances.start(int(i), seed)
            self.task.start(self.view, int(i), episode_rng(self.spec.robot, self.spec.task, "start", seed))
        self.disturbances.vary(self.seeds, mask)
        self.worlds.forward(mask)
        self.disturbances.hold(mask)
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
        self.fly(SUBSTEPS)
        self.settle()
        return executed

    def receive(self, actions: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
        """First part of :meth:`advance`: check the actions; the controllers take note of them when they next fly."""
        self._mask = self._select(mask)
        self._actions = self._checked(actions, self._mask)
        self._flights = self._userdata[:, FLIGHT].copy()
        self._arriving = np.ascontiguousarray(self.disturbances.arriving(self._actions, self._mask))
        self._fresh = True
        return self._actions

    def fly(self, steps: int) -> None:
        """Second part: some physics steps of the moving worlds, each with its tick of the controllers."""
        self._crew.run(partial(self._fly, steps))
        self._fresh = False

    def _fly(self, steps: int, counter: int) -> None:
        fly(
            self._flight,
            np.zeros(1, SCRATCH),
            self.worlds.memory,
            self._arriving,
            self._mask,
            self._fresh,
            steps,
            counter,
        )

    def settle(self) -> None:
        """Last part of :meth:`advance`: check the state, update the flags."""
        mask = self._mask
        self._check_physics(mask)
        if self._flight.level == ActionLevel.EE_POSE:
            self._commanded = np.where(mask[:, None], self._actions[:, :3], self._commanded)
        elif self._flight.level == ActionLevel.EE_DELTA:
            self._commanded = np.where(mask[:, None], self._userdata[:, TARGET], self._commanded)
        self._update_flags(mask)

    def set_state(self, states: np.ndarray, mask: np.ndarray | None = None) -> None:
        """Continue from states (n, S) that ``worlds.get_state`` returned; ``mask``: (n,) bool, the worlds to set.

        Raises:
            InvalidValueError: wrong shape or seed.
            SimulationDivergedError: a state in which MuJoCo finds NaN, infinity or huge values.
        """
        mask = self._select(mask)
        states = np.asarray(states, float)
        if states.shape != (self.n, self.spec.state_size):
            raise InvalidValueError(
                f"States have shape {(self.n, self.spec.state_size)} for this scenario, got {states.shape}."
            )
        userdata = states[:, mujoco.mj_stateSize(self.worlds.model, STATE_OFFSET) :]
        self._flights = np.nan_to_num(userdata[:, FLIGHT])
        bad = mask & ~np.isfinite(states).all(axis=1)
        if bad.any():
            self._diverged(int(np.argmax(bad)), "State to continue from is not finite")
        seeds = self._flights[:, 0]
        _check_seeds(seeds[mask])
        self.disturbances.vary(seeds, mask)
        self.worlds.set_state(states, mask)
        self._check_physics(mask)
        self._commanded[mask] = np.nan

    def observe(self) -> dict[str, np.ndarray]:
        """State observations of all worlds, ``name -> (n, ...)``."""
        return {**observe_robot(self.view, self._proprioception), **self.task.observe(self.view)}

    def judge(self) -> Judgement:
        """Rewards, flags and measurements of all worlds at this instant."""
        userdata, view = self._userdata, self.view
        success = userdata[:, mem.DWELL] >= self._dwell_steps
        use = self._act[:, : self.robot.num_rotors] / self.robot.vehicle.rotor_max
        return Judgement(
            reward=np.where(success, 1.0, self.task.reward(view)),
            success=success,
            crash=userdata[:, mem.CRASHED] > 0.0,
            dropped=userdata[:, mem.DROPPED] > 0.0,
            truncated=userdata[:, mem.STEP] >= self.spec.max_steps,
            subtasks=self.task.progress(view),
            ee_error=length(self._commanded - view.tool_pos),
            effort=np.sum(use * use, axis=1) / max(1, self.robot.num_rotors),
            contacts=view.unwanted_contacts,
            force_in_band_raw=self.task.force_in_band_raw(view),
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

    def _select(self, mask: np.ndarray | None) -> np.ndarray:
        if mask is None:
            return self._everyone
        mask = np.ascontiguousarray(mask, bool)
        if mask.shape != (self.n,):
            raise InvalidValueError(f"mask has one entry per world, ({self.n},), got {mask.shape}.")
        return mask

    def _checked(self, actions: np.ndarray, mask: np.ndarray) -> np.ndarray:
        actions = np.array(actions, float, ndmin=2)
        if actions.shape != (self.n, self.spec.action.size):
            raise InvalidValueError(
                f"{self.spec.action.level} on {self.spec.robot} takes actions of shape "
                f"{(self.n, self.spec.action.size)} ({', '.join(self.spec.action.labels)}), got {actions.shape}."
            )
        if mask is not self._everyone:
            actions[~mask] = 0.0
        if not np.isfinite(actions).all():
            self._flights = self._userdata[:, FLIGHT].copy()
            self._diverged(int(np.argmin(np.isfinite(actions).all(axis=1))), "Action is not finite")
        return self.spec.action.clip(actions)

    def _check_physics(self, mask: np.ndarray) -> None:
        """Refuse worlds that MuJoCo warned about: it goes on after a warning, from the start or without a contact."""
        world = self.worlds.first_warned(mask)
        if world < self.n:
            self._diverged(world, self.worlds.warning(world))

    def _diverged(self, world: int, what: str) -> NoReturn:
        seed, *_, step = self._flights[world]
        raise SimulationDivergedError(what.rstrip(". "), seed=int(seed), step=int(step))

    def _update_flags(self, mask: np.ndarray) -> None:
        """Note whose object is lost, and count for how long the task has been solved without that and without a crash.

        All of it lives in the simulator's state.
        """
        view, userdata = self.view, self._userdata
        self.task.remember(view, mask)
        userdata[mask & self.task.lost(view), mem.DROPPED] = 1.0
        over = (userdata[:, mem.CRASHED] > 0.0) | (userdata[:, mem.DROPPED] > 0.0)
        held = self.task.solved(view) & ~over
        dwell = userdata[:, mem.DWELL]
        np.copyto(dwell, np.where(held, dwell + 1.0, 0.0), where=mask)


def _check_seeds(seeds: np.ndarray) -> None:
    for seed in seeds:
        if not 0 <= int(seed) < LARGEST_SEED:
            raise InvalidValueError(f"Seeds are integers from 0 to 2**53 - 1, got {seed}.")
