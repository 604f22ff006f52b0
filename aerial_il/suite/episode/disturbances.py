"""A tier at work on n worlds: what it draws for an episode, what it does to models, actions and flights."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import mujoco
import numpy as np

from aerial_il import robots
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.core.kernels import address_of, kernel
from aerial_il.core.seeding import episode_rng
from aerial_il.core.specs import EnvSpec
from aerial_il.robots.robot import Robot
from aerial_il.suite import disturbances, tasks, tiers
from aerial_il.suite.disturbances.disturbance import Disturbance, Start
from aerial_il.suite.disturbances.nominal import ROTOR_GAIN, SEEN, Nominal
from aerial_il.suite.episode.hold_action import hold_action
from aerial_il.suite.physics import episode_state as layout
from aerial_il.suite.physics.hooks import (
    EFFECTS,
    EFFECTS_SIZE,
    HOOKS,
    MAX_DISTURBANCES,
    NAMES,
    NOW,
    act_all,
    note,
    now_at,
    signature,
)
from aerial_il.suite.physics.native import row_at
from aerial_il.suite.physics.view import View
from aerial_il.suite.scenario import Scenario
from aerial_il.suite.tiers import Tier
from aerial_il.suite.timing import CONTROL_DT_S

SEED, TICK = layout.SEED, layout.TICK


class HookTable:
    """Hooks of a tier's disturbances for n worlds of a robot, as the flight loop calls them.

    Attributes:
        hooks: (1,) record of :data:`aerial_il.suite.physics.hooks.HOOKS`. effects: (n,) of :data:`EFFECTS`, as they
            were last summed up. Both, and the numbers of each disturbance, are addressed: keep the table.
    """

    def __init__(self, tier: Tier, robot: Robot, worlds: int) -> None:
        if len(tier.parts) > MAX_DISTURBANCES:
            raise InvalidValueError(f"Tier {tier.name!r} has {len(tier.parts)} components; {MAX_DISTURBANCES} at most.")
        self._now, self.effects = np.zeros(worlds, NOW), np.zeros(worlds, EFFECTS)
        self._own = {name: part.record(name, robot) for name, part in tier.parts.items()}
        rows: dict[str, list[list[int]]] = {hook: [] for hook in NAMES}
        for name, own in self._own.items():
            memory = tier.memories.get(name, slice(0, 0))
            for hook, compiled in disturbances.kernels(name).items():
                address = address_of(compiled, signature(hook, own))
                rows[hook].append([address, own.ctypes.data, memory.start, memory.stop - memory.start])
        self.hooks = np.zeros(1, HOOKS)
        for hook, found in rows.items():
            self.hooks[f"num_{hook}"] = len(found)
            self.hooks[hook][0, : len(found)] = np.reshape(found, (-1, 4))
        self.hooks["now"], self.hooks["effects"] = self._now.ctypes.data, self.effects.ctypes.data


class Disturbances:
    """Disturb n worlds as the scenario's tier says.

    Args:
        scenario: the environment. view: the worlds, their models still nominal.

    Attributes:
        rotor_gain: (n, R) what the rotors give of their thrust.
        sights: of each world, fields of :data:`SEEN` by name that are not as they should be.
    """

    def __init__(self, scenario: Scenario, view: View) -> None:
        self.scenario, self.view, self.tier = scenario, view, scenario.tier
        worlds = view.worlds
        self.table = HookTable(self.tier, scenario.robot, worlds.n)
        self._nominal = Nominal(worlds.model, scenario.robot, scenario.model)
        varied = {name for part in self.tier.parts.values() for name in part.varies}
        self.rotor_gain = np.ones((worlds.n, scenario.robot.num_rotors))
        self.sights: list[dict[str, np.ndarray]] = [{} for _ in range(worlds.n)]
        self._fields = {name: self._nominal.field(name) for name in sorted(varied)}
        self._model_seeds = np.full(worlds.n, -1, np.int64)  # whose parameters each model holds; no part of the state
        self._workspace = mujoco.MjData(worlds.model) if varied - SEEN else None

    def start(self, mask: np.ndarray) -> None:
        """Draw the memories with which the episodes of the worlds in ``mask`` (n,) start, which stand where they do."""
        for i in np.flatnonzero(mask):
            userdata = self.view.userdata[i]
            stay = partial(hold_action, self.scenario, self.view, int(i))
            for name, memory in self._drawn_memories(int(userdata[SEED]), stay).items():
                userdata[self.tier.memories[name]] = memory
            for place, mark in self.tier.marks.items():
                userdata[place] = mark

    def check(self, userdata: np.ndarray) -> None:
        """Refuse what episodes of another tier remember: ``userdata`` (k, U), of states to continue from.

        Raises:
            InvalidValueError: the components whose memory is not where this tier has it.
        """
        for name, memory in self.tier.memories.items():
            mark = self.tier.marks.get(memory.start - 1)
            if mark is not None and (userdata[:, memory.start - 1] != mark).any():
                raise InvalidValueError(
                    f"States to continue from remember no {name}, or have it elsewhere: they are of another tier than "
                    f"{self.tier.name!r}. Load the environment with the tier that they were recorded in."
                )

    def vary(self, seeds: np.ndarray, mask: np.ndarray) -> None:
        """Give the worlds in ``mask`` (n,) the model parameters of their episodes ``seeds`` (n,)."""
        for i in np.flatnonzero(mask & (self._model_seeds != seeds)) if self._fields else ():
            fields = self._varied(int(seeds[i]), self.tier.parts)[0]
            self.sights[i] = {name: fields.pop(name) for name in SEEN & fields.keys()}
            if self._workspace is not None:
                model = self.view.worlds.own_model(int(i))
                for name, value in fields.items():
                    field = self.rotor_gain[i] if name == ROTOR_GAIN else getattr(model, name)
                    field[:] = value
                mujoco.mj_setConst(model, self._workspace)
            self._model_seeds[i] = seeds[i]

    def look(self, seeds: np.ndarray) -> None:
        """Show the worlds as in the episodes ``seeds`` (n,), to cameras alone, until they :meth:`vary`."""
        seen = {name: part for name, part in self.tier.parts.items() if part.seen_alone}
        for i, seed in enumerate(seeds.tolist() if seen else ()):
            fields = self._varied(seed, seen)[0]
            self.sights[i] = {name: fields[name] for name in SEEN & fields.keys()}
            self._model_seeds[i] = -1

    def drawn(self, seed: int) -> dict[str, Any]:
        """Disturbances drawn for the episode ``seed``, as plain values."""
        found = self._varied(seed, self.tier.parts)[1]
        nothing = np.zeros(self.scenario.spec.action.size)
        for name, memory in self._drawn_memories(seed, lambda: nothing).items():
            found |= self.tier.parts[name].drawn(memory)
        return found

    def _varied(self, seed: int, parts: Mapping[str, Disturbance]) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Values of the fields of an episode's model, as some disturbances change them, and what was drawn."""
        fields, drawn = {name: value.copy() for name, value in self._fields.items()}, {}
        for name, part in parts.items():
            if part.varies:
                drawn |= part.vary(fields, self._nominal, self._rng(name, seed))
        return fields, drawn

    def _drawn_memories(self, seed: int, stay: Callable[[], np.ndarray]) -> dict[str, np.ndarray]:
        parts = self.tier.parts
        return {name: parts[name].start(Start(self._rng(name, seed), stay)) for name in self.tier.memories}

    def _rng(self, purpose: str, seed: int) -> np.random.Generator:
        return episode_rng(self.scenario.robot_name, self.scenario.task_name, purpose, seed)


def effects_of(spec: EnvSpec, model: mujoco.MjModel, states: np.ndarray) -> np.ndarray:
    """Sum up what disturbances do in recorded states: for films and whoever looks at flights.

    Args:
        spec: of the recording. model: its scene, compiled. states: (N, S), as an environment returns them.

    Returns:
        (N,) records of :data:`aerial_il.suite.physics.hooks.EFFECTS`; zero where robot, task or tier is unknown.
    """
    effects = np.zeros(len(states), EFFECTS)
    try:
        robot, tier, task = robots.get(spec.robot), tiers.get(spec.tier), tasks.get(spec.task)
    except UnknownNameError:
        return effects
    before = mujoco.mj_stateSize(model, STATE_BEFORE_USERDATA)
    userdata = np.ascontiguousarray(states[:, before : before + model.nuserdata])
    if tier.userdata_size - model.nuserdata == layout.USERDATA_SIZE - layout.PAST.stop:  # until engine 3
        userdata = np.insert(userdata, [layout.PAST.stop] * (layout.USERDATA_SIZE - layout.PAST.stop), 0.0, axis=1)
    if spec.is_outside or userdata.shape[1] != tier.userdata_size + layout.sight_size(*task.sight) or robot.fixed:
        return effects
    table = HookTable(tier, robot, len(states))
    pos, vel = np.ascontiguousarray(states[:, 1:8]), np.ascontiguousarray(states[:, 1 + model.nq : 7 + model.nq])
    _act_each(table.hooks, userdata, pos, vel, CONTROL_DT_S)
    return table.effects


STATE_BEFORE_USERDATA = int(mujoco.mjtState.mjSTATE_INTEGRATION) & (int(mujoco.mjtState.mjSTATE_USERDATA) - 1)


@kernel
def _act_each(hooks, userdata, pos, vel, dt):
    """Sum up in every row of ``userdata`` (N, U), with base poses ``pos`` (N, 7) and twists ``vel`` (N, 6)."""
    table = hooks[0]
    for i in range(userdata.shape[0]):
        now, memory = now_at(table.now), row_at(userdata, i)
        note(now, memory[SEED], memory[TICK], dt, row_at(pos, i), row_at(vel, i))
        act_all(table, memory.ctypes.data, now, table.effects + i * EFFECTS_SIZE)
