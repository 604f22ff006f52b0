"""Wind: a mean that grows with height, and Dryden turbulence that it carries past the vehicle.

Profile, length scales and intensities are those of MIL-F-8785C (1980), section 3.7, low altitudes (below 1000 ft), the
model that MIL-HDBK-1797 repeats. The spectra of the standard become state equations whose discretisation is exact for
any step. A vehicle that hovers is passed by the frozen field at the speed of the mean wind (Taylor 1938), which takes
the place of the aircraft's airspeed. ``docs/disturbances.md`` has the equations.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from aerial_il.control.vehicle import GRAVITY, Vehicle
from aerial_il.core.arrays import length
from aerial_il.core.kernels import kernel
from aerial_il.core.rotations import clip
from aerial_il.robots.robot import Robot
from aerial_il.suite.disturbances.disturbance import Disturbance, Start, Strength
from aerial_il.suite.physics.aerodynamics import quadratic_drag
from aerial_il.suite.physics.noise import gaussian

FOOT = 0.3048  # m
REFERENCE_HEIGHT_M = 20.0 * FOOT  # where the standard states the mean wind
PROFILE_LOW_M = 3.0 * FOOT  # the mean wind's profile holds from here upwards
TURBULENCE_LOW_M = 10.0 * FOOT  # the turbulence's scales hold from here upwards
ROUGHNESS_M = 0.15 * FOOT  # roughness length of the ground, flight phase category C (take-off, landing)
LARGEST_GUST = 3.0  # standard deviations
WIND_SIZE = 12

WORK_HEIGHT_M = 1.0  # where a vehicle works, for setting the strength of the wind
PRESSURE_SHARE = 0.05  # of half the span: standard deviation of the centre of pressure

# Numbers of one world's wind: filter states of unit variance, then what they amount to.
ALONG, ACROSS, UP, PRESSURE = 0, 1, 3, 5  # 1, 2, 2 and 3 of them
VELOCITY, DIRECTION = 8, 11  # wind (world, m/s) in this control step; heading it blows to, rad


class Air(NamedTuple):
    """The air about one vehicle.

    Attributes:
        speed: mean wind at 20 ft (6 m), m/s; 0 for still air.
        quadratic_drag: N s²/m², beside the vehicle's linear drag.
        span: distance between opposite rotors, m: smaller eddies than this act on a part of the vehicle only.
        pressure_spread: standard deviation of the centre of pressure about the base origin along each axis, m.
    """

    speed: float
    quadratic_drag: float
    span: float
    pressure_spread: float


@dataclass(frozen=True)
class Wind(Disturbance):
    """Mean wind with Dryden turbulence.

    Attributes:
        share: by how much of the vehicle's weight the largest gust changes its drag.
    """

    share: float = 0.13
    strength: ClassVar[Strength | None] = Strength("times the change of drag in `gusts`", 0.0, 3.0)
    memory: ClassVar[int] = WIND_SIZE
    stream: ClassVar[int | None] = 0

    @classmethod
    def of(cls, strength: float) -> Wind:
        return cls(strength * cls.share)

    def unfelt(self, robot: Robot) -> str | None:
        still = robot.fixed or not robot.vehicle.drag.any()
        return f"{robot.name} has no drag, or stands fixed: it feels no wind" if still else None

    def numbers(self, robot: Robot) -> dict[str, float]:
        return air_about(robot.vehicle, self.share)._asdict()

    def start(self, at: Start) -> np.ndarray:
        return start_wind(at.rng)

    def drawn(self, memory: np.ndarray) -> dict[str, Any]:
        return {"wind_direction_rad": float(memory[DIRECTION])}

    def about(self, robot: Robot) -> dict[str, Any]:
        air = air_about(robot.vehicle, self.share)
        return {
            "speed_at_6m_m_s": air.speed,
            "speed_at_work_m_s": air.speed * mean_share(WORK_HEIGHT_M),
            "quadratic_drag_n_s2_m2": air.quadratic_drag,
        }


TIERS = {"breeze": Wind(0.06), "gusts": Wind(), "hard": Wind()}


@kernel
def advance(own, memory, now):
    """Advance the turbulence, if the robot feels air at all."""
    if own.speed > 0.0:
        advance_wind(own, memory, now.pos[2], now.seed, now.tick, now.dt)


@kernel
def act(own, memory, now, effects):
    """Add the wind, and where it attacks."""
    if own.speed > 0.0:
        where = centre_of_pressure(own, memory)
        for k in range(3):
            effects.wind[k] += memory[VELOCITY + k]
            effects.lever[k] += where[k]


@kernel
def mean_share(height):
    """Mean wind ``height`` m above the ground over that at 20 ft: logarithmic."""
    return math.log(max(height, PROFILE_LOW_M) / ROUGHNESS_M) / math.log(REFERENCE_HEIGHT_M / ROUGHNESS_M)


@kernel
def length_scales(height):
    """Length scales of the turbulence along and across the mean wind, and up, m."""
    feet = max(height, TURBULENCE_LOW_M) / FOOT
    horizontal = feet / (0.177 + 0.000823 * feet) ** 1.2
    return FOOT * horizontal, FOOT * horizontal, FOOT * feet


@kernel
def intensities(height):
    """Standard deviations along, across and up, over the mean wind at 20 ft."""
    feet = max(height, TURBULENCE_LOW_M) / FOOT
    horizontal = 0.1 / (0.177 + 0.000823 * feet) ** 0.4
    return horizontal, horizontal, 0.1


@kernel
def advance_wind(air, state, height, seed, tick, dt):
    """Advance the wind by ``dt`` s and leave its velocity in the state.

    Args:
        air: strength of the wind. state: (WIND_SIZE,) changed in place. height: of the vehicle above the ground, m.
        seed: of the episode. tick: an integer that has not been used for it before.
    """
    mean = air.speed * mean_share(height)
    along, across, up = length_scales(height)
    _advance_first_order(state, ALONG, dt * mean / along, gaussian(seed, tick, 0))
    _advance_second_order(state, ACROSS, dt * mean / across, gaussian(seed, tick, 1), gaussian(seed, tick, 2))
    _advance_second_order(state, UP, dt * mean / up, gaussian(seed, tick, 3), gaussian(seed, tick, 4))
    for k in range(3):
        _advance_first_order(state, PRESSURE + k, dt * math.pi * mean / (4.0 * air.span), gaussian(seed, tick, 5 + k))
    spread_along, spread_across, spread_up = intensities(height)
    u = mean + air.speed * spread_along * clip(state[ALONG], -LARGEST_GUST, LARGEST_GUST)
    v = air.speed * spread_across * _second_order_output(state, ACROSS)
    c, s = math.cos(state[DIRECTION]), math.sin(state[DIRECTION])
    state[VELOCITY] = c * u - s * v
    state[VELOCITY + 1] = s * u + c * v
    state[VELOCITY + 2] = air.speed * spread_up * _second_order_output(state, UP)


@kernel
def centre_of_pressure(air, state):
    """Point of attack of the air's force, relative to the base origin, m."""
    spread, low, high = air.pressure_spread, -LARGEST_GUST, LARGEST_GUST
    x, y, z = state[PRESSURE], state[PRESSURE + 1], state[PRESSURE + 2]
    return (spread * clip(x, low, high), spread * clip(y, low, high), spread * clip(z, low, high))


@kernel
def _advance_first_order(state, k, ratio, noise):
    """Gauss–Markov process of unit variance, ``ratio`` = step over time constant: 1 / (1 + T s) on white noise."""
    decay = math.exp(-ratio)
    state[k] = decay * state[k] + math.sqrt(1.0 - decay * decay) * noise


@kernel
def _advance_second_order(state, k, ratio, noise, more_noise):
    """The process above in ``state[k]``, and in ``state[k + 1]`` what 1 / (1 + T s) makes of it.

    Their stationary covariance is ((1, 1/2), (1/2, 1/2)); what the transition takes from it, noise gives back.
    """
    decay = math.exp(-ratio)
    left = decay * decay
    first = math.sqrt(1.0 - left)
    shared = (0.5 - left * (ratio + 0.5)) / first
    own = math.sqrt(max(0.5 - left * (ratio * ratio + ratio + 0.5) - shared * shared, 0.0))
    state[k + 1] = decay * (state[k + 1] + ratio * state[k]) + shared * noise + own * more_noise
    state[k] = decay * state[k] + first * noise


@kernel
def _second_order_output(state, k):
    """Output of unit variance of (1 + √3 T s) / (1 + T s)², at most ``LARGEST_GUST``."""
    root = math.sqrt(3.0)
    return clip((root * state[k] + (1.0 - root) * state[k + 1]) / math.sqrt(2.0), -LARGEST_GUST, LARGEST_GUST)


def air_about(vehicle: Vehicle, share: float) -> Air:
    """The air in which the drag of a vehicle varies by a given share of its weight.

    The same wind would toss a small vehicle and leave a large one alone. So each vehicle meets the wind whose largest
    gust (three standard deviations) changes its own drag by ``share`` of its weight at the height where it works.
    A vehicle without any drag is an ideal one, which feels no air at all.

    Args:
        vehicle: nominal model. share: of weight; 0 for still air.
    """
    if not vehicle.drag.any():
        return Air(speed=0.0, quadratic_drag=0.0, span=1.0, pressure_spread=0.0)
    linear = 0.5 * float(vehicle.drag[0] + vehicle.drag[1])
    quadratic = quadratic_drag(vehicle)
    mean, gust = mean_share(WORK_HEIGHT_M), LARGEST_GUST * intensities(WORK_HEIGHT_M)[0]
    a, b, c = quadratic * gust * (2.0 * mean + gust), linear * gust, -share * vehicle.mass * GRAVITY
    speed = (math.sqrt(b * b - 4.0 * a * c) - b) / (2.0 * a)  # drag(mean + gust) - drag(mean) = share of weight
    span = 2.0 * float(np.sqrt((vehicle.rotor_pos[:, :2] ** 2).sum(axis=1)).max())
    return Air(speed, quadratic, span, 0.5 * PRESSURE_SHARE * span)


def blow(air: Air, *, height: float, seed: int, dt: float, steps: int) -> np.ndarray:
    """Wind at a fixed place, (steps, 3) m/s along its mean, across it and up, every ``dt`` s."""
    state, found = start_wind(np.random.default_rng(seed)), np.empty((steps, 3))
    state[DIRECTION] = 0.0
    _blow(air, state, height, seed, dt, found)
    return found


@kernel
def _blow(air, state, height, seed, dt, found):
    for tick in range(found.shape[0]):
        advance_wind(air, state, height, seed, tick, dt)
        for k in range(3):
            found[tick, k] = state[VELOCITY + k]


def drag(vehicle: Vehicle, air: Air, velocity: np.ndarray) -> np.ndarray:
    """Drag (..., 3) in N of a level vehicle at rest in a wind of ``velocity`` (..., 3) m/s."""
    return (vehicle.drag + air.quadratic_drag * length(velocity)[..., None]) * velocity


def start_wind(rng: np.random.Generator) -> np.ndarray:
    """(WIND_SIZE,) state drawn from the stationary distribution, blowing in any direction."""
    state, normal = np.zeros(WIND_SIZE), rng.standard_normal(8)
    state[:VELOCITY] = normal
    for k in (ACROSS, UP):
        state[k + 1] = 0.5 * (normal[k] + normal[k + 1])
    state[DIRECTION] = rng.uniform(-math.pi, math.pi)
    return state
