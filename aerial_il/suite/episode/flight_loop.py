"""The compiled loop of a flight: controller, rotors, air and physics of every world, one control step in one call."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from aerial_il.control.controller import gripper_opening, receive_action, tick
from aerial_il.control.controller_state import CONTROLLER_STATE_SIZE
from aerial_il.control.dynamics import put, vec
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import add, mat_from_quat, norm
from aerial_il.suite.episode.assessment import assess, settle
from aerial_il.suite.episode.estimation import advance_sight
from aerial_il.suite.physics import episode_state as layout
from aerial_il.suite.physics.aerodynamics import air_wrench, follow, lag_share, lagged_command, thrust_wrench
from aerial_il.suite.physics.force_sensing import keep_sample, sense_forces
from aerial_il.suite.physics.hooks import (
    EFFECTS_SIZE,
    NOW_SIZE,
    act_all,
    advance_all,
    arrive_all,
    note,
    now_at,
)
from aerial_il.suite.physics.native import draw, mj_step1, mj_step2, row_at
from aerial_il.suite.physics.physics_batch import (
    CTRL,
    QFRC,
    QPOS,
    QVEL,
    SENSORDATA,
    SITE_XMAT,
    SITE_XPOS,
    USERDATA,
    XFRC,
    fetch_part,
    inside,
    outside,
    pull_all,
    push_state,
)
from aerial_il.suite.physics.sensing import measure, vehicle_state
from aerial_il.suite.physics.world import record_at

FORCES_START, FORCES_STOP = layout.FORCES.start, layout.FORCES.stop
THRUST_START, COMMAND_START, AIR_START = layout.THRUST.start, layout.COMMAND.start, layout.AIR.start
SEED, TICK, STEP, CRASHED = layout.SEED, layout.TICK, layout.STEP, layout.CRASHED
TILTED_OVER = 0.17  # cosine of 80°
FENCE_M = 4.0  # a base farther than this from the origin has flown away


class Flight(NamedTuple):
    """Constants of a flight, the same in all worlds and steps.

    Attributes:
        vehicle: (1,) the nominal model's record, see ``alone``.
        gains: (1,) record of ``Gains``. steering: (1,) of ``STEERING``, the flight law.
        drag: of the body, N s²/m². hooks: (1,) of the tier's disturbances.
        rotors: (R, 6) wrench of each per newton, see ``thrust_wrench``. rotor_gain: (n, R) what they give of it.
        level: action level.
        force_addresses: (K,) where the task's force sensors start in ``sensordata``.
        base_site: index of the base's site. base_contact: index of its contact count in ``sensordata``.
        dt: s, of a physics step. interval: s, between actions. substeps: physics steps between actions.
        hands: threads that share the worlds: each comes to about the ``hands``-th next.
        refinement: parts in which MuJoCo takes a physics step, to see what its length does; control keeps its rate.
    """

    vehicle: np.ndarray
    gains: np.ndarray
    steering: np.ndarray
    drag: float
    hooks: np.ndarray
    rotors: np.ndarray
    rotor_gain: np.ndarray
    level: int
    force_addresses: np.ndarray
    base_site: int
    base_contact: int
    dt: float
    interval: float
    substeps: int
    hands: int
    refinement: int = 1


@kernel
def fly(flight, rules, results, workspace, worlds, sent, actions, active, fresh, steps, counter):
    """Advance the worlds that are drawn from a counter by some physics steps.

    Args:
        flight: see :class:`Flight`. rules, results: what is asked after a control step, and where answers go.
        workspace: (1,) working memory, see ``SCRATCH``. worlds: addresses, see ``worlds.PhysicsPointers``.
        sent: (n, Da) actions as they were sent. actions: (n, Da) the same, changed to those that arrive.
        active: (n,) bool, others stand still.
        fresh: the actions are new. steps: physics steps.
        counter: address of the number of worlds that are taken already; threads that share it share the work.
    """
    vehicle, gains, hooks, steering = flight.vehicle[0], flight.gains[0], flight.hooks[0], flight.steering[0]
    scratch, dt = workspace[0], flight.dt
    rotors, level, thrust = vehicle.num_rotors, flight.level, scratch.thrust[: vehicle.num_rotors]
    pos, vel = scratch.pos[: 7 + vehicle.num_joints], scratch.vel[: 6 + vehicle.num_joints]
    falling = lag_share(vehicle.rotor_tau_down, dt) / lag_share(vehicle.rotor_tau_up, dt)
    rising = lag_share(vehicle.rotor_tau_up, dt / flight.refinement)
    measured_pos, measured_vel = scratch.measured_pos[: pos.size], scratch.measured_vel[: vel.size]
    while True:
        i = draw(counter)
        if i >= active.size:
            break
        if not active[i]:
            continue
        push_state(worlds, i, XFRC)
        qpos, qvel = inside(worlds, QPOS, i), inside(worlds, QVEL, i)
        ctrl, wrench, userdata = inside(worlds, CTRL, i), inside(worlds, QFRC, i), outside(worlds, USERDATA, i)
        state, memory = userdata[:CONTROLLER_STATE_SIZE], userdata.ctypes.data
        now, summed = now_at(hooks.now + i * NOW_SIZE), hooks.effects + i * EFFECTS_SIZE
        forces, sensordata = userdata[FORCES_START:FORCES_STOP], inside(worlds, SENSORDATA, i)
        action, gain = row_at(actions, i), row_at(flight.rotor_gain, i)
        thrust_now = userdata[THRUST_START : THRUST_START + rotors]
        command = userdata[COMMAND_START : COMMAND_START + rotors]
        vehicle_state(vehicle, qpos, qvel, pos, vel)
        if fresh:
            note(now, userdata[SEED], userdata[TICK], flight.interval, pos, vel)
            arrive_all(hooks, memory, now, action)
            receive_action(vehicle, gains, scratch, level, action, pos, state, flight.interval)
            advance_all(hooks, memory, now)
            if rules.perception.active != 0:
                world = record_at(results.records + i * results.record_size)
                advance_sight(rules.perception, world, flight.interval)
        soon = i + flight.hands
        for step in range(steps):
            if soon < active.size:
                fetch_part(worlds, soon, step, steps)
            note(now, userdata[SEED], userdata[TICK], flight.interval, pos, vel)
            effects = act_all(hooks, memory, now, summed)
            measure(vehicle, effects, pos, vel, measured_pos, measured_vel)
            tick(
                vehicle,
                gains,
                steering,
                scratch,
                level,
                action,
                measured_pos,
                measured_vel,
                thrust_now,
                state,
                dt,
                thrust,
                ctrl,
            )
            for r in range(rotors):
                command[r] = lagged_command(thrust[r], thrust_now[r], falling)
            if vehicle.gripper_stroke > 0.0:
                ctrl[vehicle.num_joints] = gripper_opening(vehicle, action) * vehicle.gripper_stroke
            force = torque = (0.0, 0.0, 0.0)
            if vehicle.base_mobility > 0.0:
                rot = mat_from_quat((pos[3], pos[4], pos[5], pos[6]))
                force, torque = air_wrench(vehicle, flight.drag, effects, vec(pos, 0), rot, vec(vel, 0), thrust_now)
                put(userdata, AIR_START, force)
            for _ in range(flight.refinement):
                if vehicle.base_mobility > 0.0:
                    rot = mat_from_quat((qpos[3], qpos[4], qpos[5], qpos[6]))
                    push, turn = thrust_wrench(flight.rotors, gain, thrust_now, rot)
                    put(wrench, 0, add(force, push))
                    put(wrench, 3, add(torque, turn))
                    follow(vehicle, command, rising, thrust_now)
                mj_step2(worlds.models[i], worlds.datas[i])
                mj_step1(worlds.models[i], worlds.datas[i])
            vehicle_state(vehicle, qpos, qvel, pos, vel)
            sense_forces(sensordata, flight.force_addresses, forces, dt)
            keep_sample(sensordata, flight.force_addresses, forces, userdata, int(userdata[TICK]) % flight.substeps)
            userdata[TICK] += 1.0
        complete = userdata[TICK] % flight.substeps == 0.0
        if complete:
            userdata[STEP] += 1.0
            if _crashed(flight, worlds, sensordata, i):
                userdata[CRASHED] = 1.0
        pull_all(worlds, i, QPOS)
        if complete:
            settle(rules, results, i, row_at(sent, i))
            assess(rules, results, i)


@kernel
def limit_actions(actions, active, low, high, executed):
    """Write actions (n, Da) limited to their bounds; those of worlds that stand still count as zero.

    Args:
        actions: (n, Da). active: (n,) bool. low, high: (Da,) bounds. executed: (n, Da) written.

    Returns:
        The first world whose action is not finite; n if there is none.
    """
    broken = active.size
    for i in range(active.size):
        for k in range(low.size):
            value = actions[i, k] if active[i] else 0.0
            if not math.isfinite(value):
                broken = min(broken, i)
            executed[i, k] = min(max(value, low[k]), high[k])
    return broken


@kernel
def _crashed(flight, worlds, sensordata, i):
    """Whether the base of world ``i`` touches something, is tilted beyond 80° or has flown away."""
    pos = vec(inside(worlds, SITE_XPOS, i), 3 * flight.base_site)
    upright = inside(worlds, SITE_XMAT, i)[9 * flight.base_site + 8]
    return sensordata[flight.base_contact] > 0.0 or upright < TILTED_OVER or norm(pos) > FENCE_M
