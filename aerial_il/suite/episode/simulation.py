"""One episode's logic for n worlds: start, fly, observe, judge. Both environments are thin faces of it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from functools import cached_property, partial
from typing import Any, NoReturn

import mujoco
import numpy as np

from aerial_il.control.controller import Steering
from aerial_il.control.scratch import SCRATCH
from aerial_il.control.vehicle import alone, record_of
from aerial_il.core import registry
from aerial_il.core.errors import InvalidValueError, SimulationDivergedError
from aerial_il.core.kernels import entry_of
from aerial_il.core.seeding import episode_rng
from aerial_il.suite.episode.assessment import (
    Assessment,
    SensorTable,
    assess_all,
    assessment_of,
    make_results,
    rules_of,
)
from aerial_il.suite.episode.disturbances import Disturbances
from aerial_il.suite.episode.flight_loop import Flight, fly, limit_actions
from aerial_il.suite.episode.perception import Perceived
from aerial_il.suite.physics import episode_state as layout
from aerial_il.suite.physics.aerodynamics import quadratic_drag
from aerial_il.suite.physics.physics_batch import STATE, PhysicsBatch
from aerial_il.suite.physics.thread_pool import ThreadPool
from aerial_il.suite.physics.view import View
from aerial_il.suite.rendering import AS_IT_IS, Sight
from aerial_il.suite.scenario import Scenario
from aerial_il.suite.timing import CONTROL_DT_S, PHYSICS_DT_S, SUBSTEPS

LARGEST_SEED = 2**53
FLIGHT = slice(layout.SEED, layout.STEP + 1)  # what identifies a moment: seed first, step last
STATE_OFFSET = int(STATE) & (int(mujoco.mjtState.mjSTATE_USERDATA) - 1)  # parts of a state that precede userdata


class _Own(threading.local):
    """What each thread has for itself: working memory of the controllers."""

    def __init__(self) -> None:
        self.workspace = np.zeros(1, SCRATCH)


class Simulation:
    """Fly n worlds of one scenario.

    Args:
        scenario: the environment. worlds: the simulator.
        num_threads: threads for the controllers, 0 for all cores.
        refinement: parts of each physics step in which ``worlds`` are stepped, see :class:`Flight`.
    """

    def __init__(
        self,
        scenario: Scenario,
        worlds: PhysicsBatch,
        num_threads: int = 0,
        *,
        refinement: int = 1,
    ) -> None:
        self.scenario, self.worlds = scenario, worlds
        self.robot, self.task, self.spec = scenario.robot, scenario.task, scenario.spec
        self._cameras = tuple(camera.name for camera in self.robot.mounted_cameras)
        self.view = View(worlds, self.robot, self.task.names)
        self.gains = registry.get("controller", scenario.controller)().gains.fitted(self.robot.vehicle)
        self._steering = Steering(scenario.controller, self.robot.vehicle)
        self.disturbances = Disturbances(scenario, self.view)
        self._threads, self._own = ThreadPool(worlds.n, num_threads), _Own()
        self._ctrl, self._userdata = worlds.bind("ctrl"), worlds.bind("userdata")
        self._flight = Flight(
            vehicle=alone(self.robot.vehicle.record),
            gains=alone(record_of(self.gains)),
            steering=self._steering.record,
            drag=quadratic_drag(self.robot.vehicle),
            hooks=self.disturbances.table.hooks,
            rotors=scenario.rotors,
            rotor_gain=self.disturbances.rotor_gain,
            level=int(scenario.level),
            force_addresses=np.array([self.view.address(name) for name in self.task.force_sensors], np.int64),
            base_site=self.view.base_site,
            base_contact=self.view.address("contact_base"),
            dt=PHYSICS_DT_S,
            interval=CONTROL_DT_S,
            substeps=SUBSTEPS,
            hands=self._threads.hands,
            refinement=refinement,
        )
        self.seen = Perceived(scenario, self.view, self.disturbances.table.hooks)
        observation = self.spec.observation
        self._sensors = SensorTable(self.robot)
        self._rules = rules_of(scenario, self._sensors, self.seen.perception)
        self._results = make_results(
            self.view, self.seen.records, observation.size(observation.state_names), len(self.spec.subtasks)
        )
        self._parts = observation.parts(observation.state_names)
        self._columns = {name: (slice(None), part) for name, part in self._parts.items()}
        self._everyone = np.ones(worlds.n, bool)
        self._mask, self._fresh = self._everyone, False
        self._actions = self._arriving = np.zeros((worlds.n, self.spec.action.size))
        self._identities = self._userdata[:, FLIGHT]
        self._flights = self._identities.copy()

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
            self._userdata[i, layout.SEED] = seed
            self.task.start(self.view, int(i), episode_rng(self.spec.robot, self.spec.task, "start", seed))
        self.disturbances.vary(self.seeds, mask)
        self.worlds.forward(mask)
        self.disturbances.start(mask)
        self.seen.begin(mask)
        self._results.commanded[mask] = np.nan
        self.assess(mask)

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

    def receive(self, actions: np.ndarray, mask: np.ndarray | None = None, *, fresh: bool = True) -> np.ndarray:
        """First part of :meth:`advance`: check the actions; the controllers take note of them when they next fly.

        ``fresh`` is False where they change within a control step, by whoever commands rotors at the physics rate.
        """
        self._mask = self._select(mask)
        self._actions = self._checked(actions, self._mask)
        self._flights = self._identities.copy()
        self._arriving = self._actions.copy()
        self._fresh = fresh
        return self._actions

    def fly(self, steps: int) -> None:
        """Second part: some physics steps of the moving worlds, each with its tick of the controllers."""
        self._threads.run(partial(self._fly, self._entry_of_fly, steps))
        self._fresh = False

    def _fly(self, entry: Callable[..., Any], steps: int, counter: int) -> None:
        entry(*self._orders(), steps, counter)

    @cached_property
    def _entry_of_fly(self) -> Callable[..., Any]:
        return entry_of(fly, *self._orders(), 0, 0)

    def _orders(self) -> tuple[Any, ...]:
        """The arguments of :func:`fly` but the last two: the same types each time."""
        return (
            self._flight,
            self._rules,
            self._results,
            self._own.workspace,
            self.worlds.pointers,
            self._actions,
            self._arriving,
            self._mask,
            self._fresh,
        )

    def settle(self) -> None:
        """Last part of :meth:`advance`: check the state."""
        self._check_physics(self._mask)

    def set_state(self, states: np.ndarray, mask: np.ndarray | None = None, *, looks: np.ndarray | None = None) -> None:
        """Continue from states (n, S) that ``worlds.get_state`` returned; ``mask``: (n,) bool, the worlds to set.

        ``looks``: (n,) seeds of the episodes that all worlds look like, where that is not their own.

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
        self.disturbances.check(userdata[mask])
        self.disturbances.vary(seeds, mask)
        if looks is not None:
            self.disturbances.look(looks)
        self.worlds.set_state(states, mask)
        self._check_physics(mask)
        self.seen.resume(mask)
        self._results.commanded[mask] = np.nan
        self.assess(mask)

    def assess(self, mask: np.ndarray | None = None) -> None:
        """Read off anew what the worlds in ``mask`` (n,) bool show and how they stand; a flight does so by itself."""
        self._threads.run(partial(self._entry_of_assess, self._rules, self._results, self._select(mask)))

    @cached_property
    def _entry_of_assess(self) -> Callable[..., Any]:
        return entry_of(assess_all, self._rules, self._results, self._everyone, 0)

    def observe(self) -> dict[str, np.ndarray]:
        """State observations of all worlds at this instant, ``name -> (n, ...)``."""
        self.assess()
        return self.observations

    @property
    def observations(self) -> dict[str, np.ndarray]:
        """The same as of the last flight, reset or :meth:`assess`."""
        flat = self._results.observations.copy()
        return {name: flat[columns] for name, columns in self._columns.items()}

    def reassess(self) -> Assessment:
        """Rewards, flags and measurements of all worlds at this instant."""
        self.assess()
        return self.assessment

    @property
    def assessment(self) -> Assessment:
        """The same as of the last flight, reset or :meth:`assess`."""
        return assessment_of(self._results)

    def observation(self, world: int) -> Iterator[tuple[str, np.ndarray]]:
        """Names and values of what one world showed then."""
        row = self._results.observations[world].copy()
        return ((name, row[part]) for name, part in self._parts.items())

    def verdict(self, world: int, kind: int) -> float:
        """One number of its assessment, see :mod:`aerial_il.suite.episode.assessment`."""
        return float(self._results.verdicts[world, kind])

    def sight(self, world: int) -> Sight:
        """How one world is seen now, where it is not as it should be."""
        fields = self.disturbances.sights[world]
        seed, step = (int(self._userdata[world, at]) for at in (layout.SEED, layout.STEP))
        return Sight(fields, self._cameras, seed, step) if fields else AS_IT_IS

    def close(self) -> None:
        """End the controllers' threads."""
        self._threads.close()

    @property
    def dwell(self) -> np.ndarray:
        """(n,) share, in [0, 1], of the time that success must hold for it has held."""
        return np.minimum(self._userdata[:, layout.DWELL] / self._rules.dwell_steps, 1.0)

    @property
    def steps(self) -> np.ndarray:
        """(n,) control steps since the start of each episode."""
        return self._userdata[:, layout.STEP].astype(int)

    @property
    def seeds(self) -> np.ndarray:
        """(n,) seeds of the episodes."""
        return self._userdata[:, layout.SEED].astype(int)

    @property
    def ctrl(self) -> np.ndarray:
        """(n, R + nu) commands of the last physics step: rotors (N), servos (rad), gripper (m)."""
        return np.concatenate([self.view.rotor_command, self._ctrl], axis=1)

    def _select(self, mask: np.ndarray | None) -> np.ndarray:
        if mask is None:
            return self._everyone
        given = np.asarray(mask)
        if given.shape != (self.n,) or not np.isin(given, (0, 1)).all():
            raise InvalidValueError(f"mask has one bool per world, ({self.n},), got {mask!r}.")
        return np.ascontiguousarray(given, bool)

    def _checked(self, actions: np.ndarray, mask: np.ndarray) -> np.ndarray:
        actions = np.array(actions, float, order="C", ndmin=2)
        if actions.shape != (self.n, self.spec.action.size):
            raise InvalidValueError(
                f"{self.spec.action.level} on {self.spec.robot} takes actions of shape "
                f"{(self.n, self.spec.action.size)} ({', '.join(self.spec.action.labels)}), got {actions.shape}."
            )
        action = self.spec.action
        broken = limit_actions(actions, mask, action.low, action.high, actions)
        if broken < self.n:
            self._flights = self._identities.copy()
            self._diverged(broken, "Action is not finite")
        return actions

    def _check_physics(self, mask: np.ndarray) -> None:
        """Refuse worlds that MuJoCo warned about: it goes on after a warning, from the start or without a contact."""
        world = self.worlds.first_warned(mask)
        if world < self.n:
            self._diverged(world, self.worlds.warning(world))

    def _diverged(self, world: int, what: str) -> NoReturn:
        seed, *_, step = self._flights[world]
        raise SimulationDivergedError(what.rstrip(". "), seed=int(seed), step=int(step))


def _check_seeds(seeds: np.ndarray) -> None:
    for seed in seeds:
        if not 0 <= int(seed) < LARGEST_SEED:
            raise InvalidValueError(f"Seeds are integers from 0 to 2**53 - 1, got {seed}.")
