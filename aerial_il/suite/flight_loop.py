"""The compiled loop between physics steps: controller, rotors and air of every world."""

from __future__ import annotations

import numpy as np

from aerial_il.control.controller import receive_action, tick
from aerial_il.control.dynamics import put, vec
from aerial_il.control.memory import MEMORY_SIZE
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import add, mat_from_quat
from aerial_il.suite import memory as mem
from aerial_il.suite.aerodynamics import advance_gusts, air_wrench, gust_wrench, lagged_command
from aerial_il.suite.sensing import advance_noise, measure

NOISE_START, NOISE_STOP = mem.NOISE.start, mem.NOISE.stop
GUST_START, GUST_STOP = mem.GUST.start, mem.GUST.stop
SEED, TICK = mem.SEED, mem.TICK


@kernel
def receive_actions(vehicle, gains, level, actions, active, qpos, userdata, interval):
    """Hand a new action (n, Da) to the controllers of the ``active`` (n,) worlds; ``interval``: s between actions."""
    for i in range(active.size):
        if active[i]:
            receive_action(vehicle, gains, level, actions[i], qpos[i], userdata[i, :MEMORY_SIZE], interval)


@kernel
def fly(
    vehicle, gains, air, sensors, level, actions, active, qpos, qvel, act, ctrl, xfrc, userdata, gripper_stroke, dt
):
    """One controller tick in every active world: measures the state, writes ctrl and the base's external wrench.

    Args:
        vehicle, gains, air, sensors: parameters. level: action level. actions: (n, Da).
        active: (n,) bool. qpos, qvel, act, ctrl: (n, ...) simulator state; rotors come first in act and ctrl, then
            servos, then the gripper. xfrc: (n, nbody, 6), base is body 1. userdata: (n, U). dt: s.
    """
    rotors, joints = vehicle.rotor_max.size, vehicle.link_mass.size
    thrust, measured_pos, measured_vel = np.empty(rotors), np.empty(7 + joints), np.empty(6 + joints)
    for i in range(active.size):
        if not active[i]:
            continue
        memory = userdata[i, :MEMORY_SIZE]
        servo = ctrl[i, rotors : rotors + joints]
        noise = userdata[i, NOISE_START:NOISE_STOP]
        advance_noise(sensors, noise, userdata[i, SEED], userdata[i, TICK], dt)
        measure(sensors, noise, qpos[i], qvel[i], measured_pos, measured_vel)
        tick(vehicle, gains, level, actions[i], measured_pos, measured_vel, act[i], memory, dt, thrust, servo)
        for r in range(rotors):
            ctrl[i, r] = lagged_command(thrust[r], act[i, r], vehicle.rotor_tau_up, vehicle.rotor_tau_down, dt)
        opening = min(max(actions[i, actions.shape[1] - 1], 0.0), 1.0)
        ctrl[i, rotors + joints] = opening * gripper_stroke
        rot = mat_from_quat((qpos[i, 3], qpos[i, 4], qpos[i, 5], qpos[i, 6]))
        force, torque = air_wrench(vehicle, vec(qpos[i], 0), rot, vec(qvel[i], 0), act[i])
        if air.gust_force > 0.0:
            gust = userdata[i, GUST_START:GUST_STOP]
            advance_gusts(air, gust, userdata[i, SEED], userdata[i, TICK], dt)
            gust_force, gust_torque = gust_wrench(air, gust)
            force, torque = add(force, gust_force), add(torque, gust_torque)
        put(xfrc[i, 1], 0, force)
        put(xfrc[i, 1], 3, torque)
        userdata[i, TICK] += 1.0
