"""Observations, rewards and flags of n worlds, read off by the threads that fly them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numba import types

from aerial_il.control.actions import ActionLevel
from aerial_il.control.controller_state import TARGET_POS
from aerial_il.control.dynamics import put, vec
from aerial_il.core import registry
from aerial_il.core.addresses import numbers_at
from aerial_il.core.kernels import address_of, kernel
from aerial_il.core.rotations import norm, sub
from aerial_il.robots.robot import Robot
from aerial_il.suite import sensors
from aerial_il.suite.episode.estimation import Perception, perceive
from aerial_il.suite.physics import episode_state as layout
from aerial_il.suite.physics.hooks import EFFECTS_SIZE, NOW_SIZE
from aerial_il.suite.physics.native import doubles, draw, row_at
from aerial_il.suite.physics.view import View
from aerial_il.suite.physics.world import (
    RECORD,
    RETURNS_NOTHING,
    RETURNS_NUMBER,
    ROW,
    WRITES_ROW,
    call_nothing,
    call_number,
    call_row,
    call_sensor,
    record_at,
    rotor_thrust,
    tool_pos,
    unwanted_contacts,
)
from aerial_il.suite.scenario import Scenario
from aerial_il.suite.tasks.task import Task
from aerial_il.suite.timing import CONTROL_DT_S

DWELL, CRASHED, LOST = layout.DWELL, layout.CRASHED, layout.DROPPED
STEP, USERDATA_SIZE = layout.STEP, layout.USERDATA_SIZE
EE_POSE, EE_DELTA = int(ActionLevel.EE_POSE), int(ActionLevel.EE_DELTA)
REWARD, SUCCESS, CRASH, DROPPED, TRUNCATED, EE_ERROR, EFFORT, CONTACTS, FORCE_IN_BAND_RAW = range(9)
NUM_VERDICTS = 9


class Assessment(NamedTuple):
    """Rewards, flags and measurements of n worlds after a step. Each array is (n,), ``subtasks`` is (n, K).

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


class Rules(NamedTuple):
    """Rules by which every world is assessed.

    Attributes:
        observe, solved, progress, reward, remember, lost, force_in_band_raw: addresses of the task's compiled
            functions; 0 for none.
        dwell_steps: control steps for which ``solved`` must hold. max_steps: control steps until the time is up.
        sensors: (K, 4) of the robot: addresses of each kernel and of its numbers, first column and count of what it
            writes. level: action level. proprioception: numbers of the robot's own observation, which comes first.
        rotor_max: (R,) largest thrusts, N. perception: how observations differ from the truth.
    """

    observe: int
    solved: int
    progress: int
    reward: int
    remember: int
    lost: int
    force_in_band_raw: int
    dwell_steps: int
    max_steps: int
    sensors: np.ndarray
    level: int
    proprioception: int
    rotor_max: np.ndarray
    perception: Perception


class Results(NamedTuple):
    """Buffers for observations and assessments, a row per world.

    Attributes:
        records: address of the worlds' records. record_size: bytes of each.
        seen: address of the records that observations are read off: those of the truth, or of what is estimated.
        observations: (n, Do). verdicts: (n, NUM_VERDICTS). subtasks: (n, K) of zeros and ones.
        commanded: (n, 3) tool position last commanded, world, m; NaN for none.
    """

    records: int
    record_size: int
    seen: int
    observations: np.ndarray
    verdicts: np.ndarray
    subtasks: np.ndarray
    commanded: np.ndarray


class SensorTable:
    """Sensors of a robot, as worlds are observed with them.

    Attributes:
        rows: (K, 4) see :class:`Rules`; they hold addresses of the table: keep it. size: numbers of all together.
    """

    def __init__(self, robot: Robot) -> None:
        self._own, rows, self.size = [], [], 0
        for name, sensor, fields in sensors.of(robot):
            own, size = sensor.record(name, robot), sum(field.size for field in fields)
            signature = types.void(numba.from_dtype(own.dtype), RECORD, RECORD, ROW)
            rows.append(
                [address_of(registry.kernel("sensor", name, "read"), signature), own.ctypes.data, self.size, size]
            )
            self._own.append(own)
            self.size += size
        self.rows = np.array(rows, np.int64).reshape(-1, 4)


def rules_of(scenario: Scenario, table: SensorTable, perception: Perception) -> Rules:
    """Return the rules of a scenario whose robot has those sensors and sees so."""
    task, spec = scenario.task, scenario.spec
    kernels = task.kernels
    return Rules(
        observe=address_of(kernels.observe, WRITES_ROW),
        solved=address_of(kernels.solved, RETURNS_NUMBER),
        progress=address_of(kernels.progress, WRITES_ROW),
        reward=address_of(kernels.reward, RETURNS_NUMBER),
        remember=address_of(kernels.remember, RETURNS_NOTHING) if kernels.remember else 0,
        lost=address_of(kernels.lost, RETURNS_NUMBER) if kernels.lost else 0,
        force_in_band_raw=address_of(kernels.force_in_band_raw, RETURNS_NUMBER) if kernels.force_in_band_raw else 0,
        dwell_steps=dwell_steps(task),
        max_steps=spec.max_steps,
        level=int(scenario.level),
        sensors=table.rows,
        proprioception=table.size,
        rotor_max=np.array(scenario.robot.vehicle.rotor_max, float),
        perception=perception,
    )


def dwell_steps(task: Task) -> int:
    """Return for how many control steps ``task`` must be solved."""
    return max(1, round(task.dwell_s / CONTROL_DT_S))


def make_results(view: View, seen: np.ndarray, observation_size: int, num_subtasks: int) -> Results:
    """Return empty rows for the worlds of ``view``, of which observations are read off the records ``seen``."""
    n = view.n
    return Results(
        records=view.records.ctypes.data,
        record_size=view.records.itemsize,
        seen=seen.ctypes.data,
        observations=np.zeros((n, observation_size)),
        verdicts=np.zeros((n, NUM_VERDICTS)),
        subtasks=np.zeros((n, num_subtasks)),
        commanded=np.full((n, 3), np.nan),
    )


def assessment_of(results: Results) -> Assessment:
    """Copy the verdicts."""
    verdicts = results.verdicts.copy()
    flags = verdicts.astype(bool)
    return Assessment(
        reward=verdicts[:, REWARD],
        success=flags[:, SUCCESS],
        crash=flags[:, CRASH],
        dropped=flags[:, DROPPED],
        truncated=flags[:, TRUNCATED],
        subtasks=results.subtasks.astype(bool),
        ee_error=verdicts[:, EE_ERROR],
        effort=verdicts[:, EFFORT],
        contacts=verdicts[:, CONTACTS],
        force_in_band_raw=verdicts[:, FORCE_IN_BAND_RAW],
    )


@kernel
def settle(rules, results, i, action):
    """Note in the memory of world ``i`` what a control step has brought: command, task's memory, loss, dwell.

    Args:
        rules, results: see above. action: (Da,) as it was sent.
    """
    world = record_at(results.records + i * results.record_size)
    userdata = doubles(world.userdata, USERDATA_SIZE)
    if rules.level == EE_POSE:
        put(row_at(results.commanded, i), 0, vec(action, 0))
    elif rules.level == EE_DELTA:
        put(row_at(results.commanded, i), 0, vec(userdata, TARGET_POS))
    if rules.remember != 0:
        call_nothing(rules.remember, world)
    if rules.lost != 0 and call_number(rules.lost, world) > 0.0:
        userdata[LOST] = 1.0
    over = userdata[CRASHED] > 0.0 or userdata[LOST] > 0.0
    held = call_number(rules.solved, world) > 0.0 and not over
    userdata[DWELL] = userdata[DWELL] + 1.0 if held else 0.0


@kernel
def assess(rules, results, i):
    """Write the observation, the verdicts and the sub-task flags of world ``i``."""
    world = record_at(results.records + i * results.record_size)
    userdata, success = doubles(world.userdata, USERDATA_SIZE), 0.0
    if userdata[DWELL] >= rules.dwell_steps:
        success = 1.0
    verdicts = row_at(results.verdicts, i)
    verdicts[SUCCESS] = success
    verdicts[REWARD] = 1.0 if success > 0.0 else call_number(rules.reward, world)
    verdicts[CRASH] = 1.0 if userdata[CRASHED] > 0.0 else 0.0
    verdicts[DROPPED] = 1.0 if userdata[LOST] > 0.0 else 0.0
    verdicts[TRUNCATED] = 1.0 if userdata[STEP] >= rules.max_steps else 0.0
    verdicts[EE_ERROR] = norm(sub(vec(row_at(results.commanded, i), 0), tool_pos(world)))
    verdicts[EFFORT] = _effort(rules, world)
    verdicts[CONTACTS] = unwanted_contacts(world)
    verdicts[FORCE_IN_BAND_RAW] = math.nan
    if rules.force_in_band_raw != 0:
        verdicts[FORCE_IN_BAND_RAW] = call_number(rules.force_in_band_raw, world)
    call_row(rules.progress, world, row_at(results.subtasks, i))
    seen = record_at(results.seen + i * results.record_size)
    if rules.perception.active != 0:
        hooks = rules.perception.hooks[0]
        perceive(rules.perception, world, seen, hooks.now + i * NOW_SIZE, hooks.effects + i * EFFECTS_SIZE)
    observations = row_at(results.observations, i)
    for k in range(rules.sensors.shape[0]):
        own, place, size = rules.sensors[k, 1], rules.sensors[k, 2], rules.sensors[k, 3]
        numbers = doubles(observations.ctypes.data + 8 * place, size)
        call_sensor(rules.sensors[k, 0], numbers_at(own), world, seen, numbers)
    rest = observations.size - rules.proprioception
    call_row(rules.observe, seen, doubles(observations.ctypes.data + 8 * rules.proprioception, rest))


@kernel
def assess_all(rules, results, active, counter):
    """Assess the worlds of ``active`` (n,) bool that are drawn from a counter; see :func:`native.draw`."""
    while True:
        i = draw(counter)
        if i >= active.size:
            break
        if active[i]:
            assess(rules, results, i)


@kernel
def _effort(rules, world):
    thrust, total = rotor_thrust(world, rules.rotor_max.size), 0.0
    for r in range(rules.rotor_max.size):
        use = thrust[r] / rules.rotor_max[r]
        total += use * use
    return total / max(1, rules.rotor_max.size)
