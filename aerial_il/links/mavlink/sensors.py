"""Sensors of a simulated autopilot: what each makes of the base's true motion, with errors that repeat by seed.

Magnitudes of the IMU and the magnetometer are those of the ADIS16448 as RotorS and PX4's Gazebo simulations model it
(Furrer et al. 2016); of the receivers, those of the data sheets of u-blox' M8N and, with corrections, F9P; of motion
capture, what its makers say of rooms of some metres.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from aerial_il.core.errors import UnknownNameError
from aerial_il.core.seeding import named_rng
from aerial_il.links.mavlink.frames import Home, exponential, matrix, multiply, pressure_at, swap_body, swap_world
from aerial_il.suite.timing import PHYSICS_DT_S

MAG_EVERY, BARO_EVERY = 5, 10  # physics steps: 50 and 25 Hz


@dataclass(frozen=True)
class Motion:
    """True motion of the base at one moment, in our frames.

    Attributes:
        pos, vel: (3,) world, m and m/s. quat: (4,) world from base. angvel: (3,) base axes, rad/s.
        specific_force: (3,) acceleration without gravity's, base axes, m/s²: (0, 0, 9.81) at rest and level.
    """

    pos: np.ndarray
    vel: np.ndarray
    quat: np.ndarray
    angvel: np.ndarray
    specific_force: np.ndarray


@dataclass(frozen=True)
class Imu:
    """Densities of white noise in units per √Hz, of random walks in units per s per √Hz, and what biases begin with.

    Attributes:
        accel_noise, accel_walk: m/s². gyro_noise, gyro_walk: rad/s. accel_bias, gyro_bias: standard deviations.
    """

    accel_noise: float = 1.86e-3
    accel_walk: float = 6.0e-3
    accel_bias: float = 0.05
    gyro_noise: float = 1.87e-4
    gyro_walk: float = 3.88e-5
    gyro_bias: float = 5.0e-3


@dataclass(frozen=True)
class Magnetometer:
    """noise: gauss, of a reading. bias: gauss, standard deviation: what calibration has left."""

    noise: float = 2.0e-3
    bias: float = 2.0e-3


@dataclass(frozen=True)
class Barometer:
    """noise: m, of a reading. drift, drift_time_s: standard deviation, m, and time constant. delay_s: of readings."""

    noise: float = 0.1
    drift: float = 0.3
    drift_time_s: float = 120.0
    delay_s: float = 0.04


@dataclass(frozen=True)
class Gps:
    """A receiver.

    Attributes:
        rate_hz: of fixes, a divisor of 250. delay_s: of what it says.
        noise: (2,) m, standard deviations of a fix, horizontal and vertical. drift, drift_time_s: the same of errors
            that wander, and their time constant. speed: (2,) m/s.
        fix_type: 3: without corrections, 6: RTK with ambiguities fixed.
    """

    rate_hz: int = 10
    delay_s: float = 0.1
    noise: tuple[float, float] = (0.01, 0.015)
    drift: tuple[float, float] = (0.01, 0.02)
    drift_time_s: float = 60.0
    speed: tuple[float, float] = (0.05, 0.08)
    fix_type: int = 6


@dataclass(frozen=True)
class MotionCapture:
    """Cameras around the vehicle.

    Attributes:
        every: physics steps from one pose to the next. delay_s: of what they say.
        noise: m. turn_noise: rad, of each angle.
    """

    every: int = 5
    delay_s: float = 0.02
    noise: float = 1.0e-3
    turn_noise: float = 4.0e-3


GPS = {
    "rtk": Gps(),
    "standard": Gps(rate_hz=5, noise=(0.2, 0.3), drift=(1.0, 1.5), drift_time_s=120.0, speed=(0.05, 0.1), fix_type=3),
}
PLACES = (*GPS, "mocap")


@dataclass(frozen=True)
class Fix:
    """What a receiver says: position (3,) east, north, up of home, m, and velocity (3,), m/s."""

    pos: np.ndarray
    vel: np.ndarray


@dataclass(frozen=True)
class Pose:
    """What motion capture says: position (3,) m and quaternion (4,), in our frames."""

    pos: np.ndarray
    quat: np.ndarray


@dataclass(frozen=True)
class Sensed:
    """One sample of all sensors; None for those that have nothing new. In the wire's body frame.

    Attributes:
        accel, gyro: (3,) forward, right, down, m/s² and rad/s; (0, 0, -9.81) at rest. mag: (3,) gauss.
        pressure: Pa. fix: of the receiver. pose: of motion capture.
    """

    accel: np.ndarray
    gyro: np.ndarray
    mag: np.ndarray | None
    pressure: float | None
    fix: Fix | None
    pose: Pose | None


class Sensors:
    """All sensors of one vehicle in one episode.

    Args:
        place: what tells the position: ``rtk`` or ``standard``, a receiver of that grade, or ``mocap``.
        home: where the world's origin is. seed: of the episode.

    Raises:
        UnknownNameError: nothing of that name.
    """

    def __init__(self, place: str = "rtk", home: Home | None = None, *, seed: int = 0) -> None:
        if place not in PLACES:
            raise UnknownNameError("place", place, PLACES)
        self.gps, self.home = GPS.get(place), home or Home()
        self.cameras = None if self.gps else MotionCapture()
        self.imu, self.magnetometer, self.barometer = Imu(), Magnetometer(), Barometer()
        imu, mag, baro, outside = (named_rng(seed, "mavlink", name) for name in ("imu", "mag", "baro", "place"))
        self._imu_rng, self._mag_rng, self._baro_rng, self._outside_rng = imu, mag, baro, outside
        self._biases = np.repeat([self.imu.accel_bias, self.imu.gyro_bias], 3) * imu.standard_normal(6)
        self._mag_bias = self.magnetometer.bias * mag.standard_normal(3)
        dt, tick = PHYSICS_DT_S, 1.0 / PHYSICS_DT_S
        self._white = np.repeat([self.imu.accel_noise, self.imu.gyro_noise], 3) * math.sqrt(tick)
        self._walk = np.repeat([self.imu.accel_walk, self.imu.gyro_walk], 3) * math.sqrt(dt)
        self._field = swap_world(np.array(self.home.field_gauss))
        gps = self.gps or GPS["rtk"]
        self._gps_every = round(tick / gps.rate_hz)
        spread = np.array([gps.drift[0], gps.drift[0], gps.drift[1]])
        self._gps_drift = _Wandering(spread, gps.drift_time_s, self._gps_every * dt, outside)
        once = BARO_EVERY * dt
        self._baro_drift = _Wandering(np.array([self.barometer.drift]), self.barometer.drift_time_s, once, baro)
        self._fixes: deque[tuple[int, Fix]] = deque()
        self._poses: deque[tuple[int, Pose]] = deque()
        self._heights: deque[float] = deque(maxlen=1 + round(self.barometer.delay_s / dt))
        self._tick = 0

    def read(self, motion: Motion) -> Sensed:
        """Return what the sensors say 4 ms after the last call."""
        now, self._tick = self._tick, self._tick + 1
        self._heights.append(float(motion.pos[2]))
        self._biases += self._walk * self._imu_rng.standard_normal(6)
        errors = self._biases + self._white * self._imu_rng.standard_normal(6)
        return Sensed(
            accel=swap_body(motion.specific_force) + errors[:3],
            gyro=swap_body(motion.angvel) + errors[3:],
            mag=self._magnetic(motion) if now % MAG_EVERY == 0 else None,
            pressure=self._pressure() if now % BARO_EVERY == 0 else None,
            fix=self._receive(self.gps, motion, now) if self.gps else None,
            pose=self._track(self.cameras, motion, now) if self.cameras else None,
        )

    def _magnetic(self, motion: Motion) -> np.ndarray:
        errors = self._mag_bias + self.magnetometer.noise * self._mag_rng.standard_normal(3)
        return swap_body(matrix(motion.quat).T @ self._field) + errors

    def _pressure(self) -> float:
        error = self._baro_drift.advance()[0] + self.barometer.noise * self._baro_rng.standard_normal()
        return pressure_at(self.home.alt_m + self._heights[0] + error)

    def _receive(self, gps: Gps, motion: Motion, now: int) -> Fix | None:
        """Measure when it is time to, and return a fix when its delay is over."""
        if now % self._gps_every == 0:
            (flat, up), (slow, climb) = gps.noise, gps.speed
            noise = np.array([flat, flat, up, slow, slow, climb]) * self._outside_rng.standard_normal(6)
            fix = Fix(motion.pos + self._gps_drift.advance() + noise[:3], motion.vel + noise[3:])
            self._fixes.append((now + round(gps.delay_s / PHYSICS_DT_S), fix))
        return self._fixes.popleft()[1] if self._fixes and self._fixes[0][0] == now else None

    def _track(self, cameras: MotionCapture, motion: Motion, now: int) -> Pose | None:
        """The same for motion capture."""
        if now % cameras.every == 0:
            moved, turned = self._outside_rng.standard_normal((2, 3))
            quat = multiply(motion.quat, exponential(cameras.turn_noise * turned))
            pose = Pose(motion.pos + cameras.noise * moved, quat)
            self._poses.append((now + round(cameras.delay_s / PHYSICS_DT_S), pose))
        return self._poses.popleft()[1] if self._poses and self._poses[0][0] == now else None


class _Wandering:
    """Errors that wander about zero: Gauss–Markov processes with a stationary spread (n,), in steps of ``dt`` s."""

    def __init__(self, spread: np.ndarray, time_s: float, dt: float, rng: np.random.Generator) -> None:
        self._decay, self._rng = math.exp(-dt / time_s), rng
        self._kick = math.sqrt(1.0 - self._decay**2) * spread
        self._value = spread * rng.standard_normal(spread.size)

    def advance(self) -> Any:
        self._value = self._decay * self._value + self._kick * self._rng.standard_normal(self._value.size)
        return self._value
