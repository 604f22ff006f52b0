"""Manoeuvres of a hovering base: its target jumps, it is tilted or pushed, it holds still; and what is measured."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType

import mujoco
import numpy as np

from aerial_il.control.controller import Controller
from aerial_il.control.vehicle import GRAVITY
from aerial_il.core.contracts import attach
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.props.place import place
from aerial_il.suite.timing import CONTROL_DT_S
from experiments.flight_control.pilots import LawPilot, Pilot

STEPS = ("forward", "up", "heading", "attitude")
FORWARD_M, UP_M, HEADING_RAD, TILT_RAD, PUSH_M_S = 0.4, 0.3, np.deg2rad(30.0), np.deg2rad(30.0), 1.0
SETTLE_S, WATCHED_S, HELD_S = 4.0, 4.0, 10.0
SETTLED, RECOVERED_M = 0.1, 0.05  # share of a step; distance from the target
AT = np.array([0.0, 0.0, 0.9])  # m, where the target is at first
TIMED = 300  # decisions
STAYS = 25  # steps at least for which something must have stayed where it is to be, to count as settled


@dataclass(frozen=True)
class Mismatch:
    """How the vehicle differs from the one that laws are tuned for and policies were trained on.

    Attributes:
        mass: factor of mass and inertia. motor: factor of the thrust of one rotor.
    """

    mass: float = 1.0
    motor: float = 1.0

    def apply(self, env: BatchEnvironment) -> None:
        """Change the model of every world; the controller goes by the nominal one."""
        for world in range(env.num_envs):
            model = env.simulation.worlds.own_model(world)
            base = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, "base")
            model.body_mass[base] *= self.mass
            model.body_inertia[base] *= self.mass
            env.simulation.disturbances.rotor_gain[world, 0] *= self.motor


NOMINAL = Mismatch()


@dataclass(frozen=True)
class Response:
    """A step response.

    Attributes:
        rise_s: from 10 % to 90 %; None if it never gets there. overshoot_percent: of the step.
        settling_s: until it stays within 10 %; None if it has not for the last half second.
        offset_percent: mean distance from the end over the last fifth.
    """

    rise_s: float | None
    overshoot_percent: float
    settling_s: float | None
    offset_percent: float


@dataclass(frozen=True)
class Held:
    """Ten seconds of holding still, means over the flights up to a crash; None where all crashed before.

    Attributes:
        rmse_cm: root mean square distance from the target. tilt_deg: root mean square angle from the upright.
        power: mean of (thrust / hovering thrust)^1.5 over the rotors, as induced power goes; 1 in still air.
        activity_n_s: root mean square rate of a rotor's thrust, N/s. crashed: share of the flights.
    """

    rmse_cm: float | None
    tilt_deg: float | None
    power: float | None
    activity_n_s: float | None
    crashed: float


@dataclass(eq=False)
class Flight:
    """Worlds of ``hover``, their targets in one place, that a pilot has settled in.

    Attributes:
        pilot: who flies. tier: of disturbance. seeds: (W,) one world each. seconds: watched. threads: of the
            simulation. mismatch: of the vehicle.
        flying: (W,) which have not crashed.
    """

    pilot: Pilot
    tier: str
    seeds: np.ndarray
    seconds: float
    threads: int
    mismatch: Mismatch = NOMINAL

    def __enter__(self) -> Flight:
        steps = round((SETTLE_S + self.seconds) / CONTROL_DT_S)
        self.env = self.pilot.environment(self.tier, len(self.seeds), steps, threads=self.threads)
        self.flying, self._policy = np.ones(len(self.seeds), bool), self.pilot.policy()
        attach(self._policy, self.env)
        self.env.reset(self.seeds)
        self.mismatch.apply(self.env)
        self._policy.reset()
        self.target(AT)
        for _ in range(round(SETTLE_S / CONTROL_DT_S)):
            self.step()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.env.close()

    def target(self, pos: np.ndarray, yaw: float = 0.0) -> None:
        """Put the target to ``pos`` (3,) m with heading ``yaw`` rad, at once, in all worlds."""
        view = self.env.simulation.view
        for world in range(view.n):
            place(view, world, "target", pos, yaw=yaw)
        self.changed()
        self.pilot.retarget(self.env)

    def changed(self) -> None:
        """Let everything that follows from a written state follow."""
        self.env.simulation.worlds.forward()
        self._obs = self.env.observe()

    def step(self) -> None:
        """Fly one control step."""
        result = self.env.step(self._policy.act(self._obs), self.flying)
        self._obs = result.obs
        self.flying &= ~result.info["crash"]

    def away(self) -> np.ndarray:
        """(W,) distance from the target, m; NaN of those that have crashed."""
        view = self.env.simulation.view
        return np.where(self.flying, np.linalg.norm(view.site_pos("target") - view.base_pos, axis=1), np.nan)

    def watch(self, measure: Callable[[], np.ndarray]) -> np.ndarray:
        """Fly on to the end and return what was measured after each step, (T, ...)."""
        found = []
        for _ in range(round(self.seconds / CONTROL_DT_S)):
            self.step()
            found.append(measure())
        return np.stack(found)


def respond(pilot: Pilot, step: str, seeds: np.ndarray, *, threads: int) -> np.ndarray:
    """Return the mean response (T,) to a step in calm air: the share that has been made after each control step.

    Args:
        pilot: who flies. step: one of ``STEPS``. seeds: (W,) of the sensors' noise, one world each.
    """
    with Flight(pilot, "calm", seeds, WATCHED_S, threads) as flight:
        view = flight.env.simulation.view
        if step == "attitude":
            view.qpos[:, 3:7] = [np.cos(0.5 * TILT_RAD), np.sin(0.5 * TILT_RAD), 0.0, 0.0]
            flight.changed()
            return flight.watch(lambda: 1.0 - np.arctan2(view.base_mat[:, 7], view.base_mat[:, 8]) / TILT_RAD).mean(1)
        if step == "heading":
            flight.target(AT, HEADING_RAD)
            return flight.watch(lambda: np.arctan2(view.base_mat[:, 3], view.base_mat[:, 0]) / HEADING_RAD).mean(1)
        axis, size = (0, FORWARD_M) if step == "forward" else (2, UP_M)
        flight.target(AT + size * np.eye(3)[axis])
        return flight.watch(lambda: (view.base_pos[:, axis] - AT[axis]) / size).mean(1)


def push(pilot: Pilot, seeds: np.ndarray, *, threads: int) -> np.ndarray:
    """Return the mean distance (T,) m from the target after a blow that gives the base 1 m/s sideways, in calm air."""
    with Flight(pilot, "calm", seeds, WATCHED_S, threads) as flight:
        flight.env.simulation.view.qvel[:, 1] += PUSH_M_S
        flight.changed()
        return flight.watch(flight.away).mean(1)


def hold(pilot: Pilot, tier: str, seeds: np.ndarray, *, threads: int, mismatch: Mismatch = NOMINAL) -> Held:
    """Fly to the target, settle, and hold still for ten seconds; see :class:`Held`.

    Args:
        pilot: who flies. tier: of disturbance. seeds: (W,) one world each. mismatch: of the vehicle.
    """
    with Flight(pilot, tier, seeds, HELD_S, threads, mismatch) as flight:
        view = flight.env.simulation.view
        thrusts = view.thrust

        def seen() -> np.ndarray:
            tilt = np.where(flight.flying, np.arccos(np.clip(view.base_mat[:, 8], -1.0, 1.0)), np.nan)
            still = np.where(flight.flying[:, None], thrusts, np.nan)
            return np.column_stack([flight.away(), tilt, still])

        away, tilt, *thrust = np.moveaxis(flight.watch(seen), 2, 0)
        return held(away, tilt, np.stack(thrust, 2), view.robot.vehicle.mass * GRAVITY, ~flight.flying)


def held(away: np.ndarray, tilt: np.ndarray, thrust: np.ndarray, weight: float, crashed: np.ndarray) -> Held:
    """Sum up distances (T, W) m, tilts (T, W) rad and thrusts (T, W, R) N, NaN from a crash on.

    Args:
        weight: nominal, N. crashed: (W,).
    """
    share, rate = thrust * thrust.shape[2] / weight, np.diff(thrust, axis=0) / CONTROL_DT_S
    if np.isnan(away).all():
        return Held(None, None, None, None, 1.0)
    return Held(
        rmse_cm=round(100.0 * _rms(away), 2),
        tilt_deg=round(float(np.rad2deg(_rms(tilt))), 2),
        power=round(float(np.nanmean(np.maximum(share, 0.0) ** 1.5)), 3),
        activity_n_s=round(_rms(rate), 1),
        crashed=round(float(crashed.mean()), 3),
    )


def response_of(made: np.ndarray) -> Response:
    """Measure a response (T,), the share of the step that has been made at each control step after it."""
    levels = [np.flatnonzero(made >= level) for level in (0.1, 0.9)]
    outside = np.flatnonzero(np.abs(made - 1.0) > SETTLED)
    settled = 0 if outside.size == 0 else int(outside[-1]) + 1
    last = made[-max(1, len(made) // 5) :]
    return Response(
        rise_s=round(float(levels[1][0] - levels[0][0]) * CONTROL_DT_S, 3) if levels[1].size else None,
        overshoot_percent=round(max(0.0, 100.0 * float(made.max() - 1.0)), 1),
        settling_s=None if settled > len(made) - STAYS else round(settled * CONTROL_DT_S, 3),
        offset_percent=round(100.0 * abs(float(last.mean() - 1.0)), 1),
    )


def recovery_s(away: np.ndarray) -> float | None:
    """Return when distances (T,) m fall below 5 cm for good, s; None if they do not."""
    outside = np.flatnonzero(~(away <= RECOVERED_M))
    after = 0 if outside.size == 0 else int(outside[-1]) + 1
    return None if after > len(away) - STAYS else round(after * CONTROL_DT_S, 2)


def decision_us(pilot: Pilot) -> float:
    """Return the median time that a pilot takes for one action of one vehicle, µs, called from Python.

    Of a policy it is that of its answer, every 20 ms; of a law that of the five ticks which it takes meanwhile.
    """
    with Flight(pilot, "calm", np.array([0]), WATCHED_S, 1) as flight:
        policy, obs, view = pilot.policy(), flight.env.observe(), flight.env.simulation.view
        if not isinstance(pilot, LawPilot):
            return _median_us(lambda: policy.act(obs))
        command, thrust = policy.act(obs)[0], view.thrust[0]
        state = view.qpos[0, :7].copy(), view.qvel[0, :6].copy(), thrust.copy()
        controller = Controller(view.robot.vehicle, level="base_joint", law=pilot.law)
        return _median_us(lambda: [controller.update(command, *state) for _ in range(controller.ticks_per_action)])


def _median_us(work: Callable[[], object]) -> float:
    spent = []
    for _ in range(TIMED):
        started = time.perf_counter()
        work()
        spent.append(time.perf_counter() - started)
    return round(1e6 * float(np.median(spent)), 1)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(values**2)))
