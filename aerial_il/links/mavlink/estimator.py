"""Where the vehicle is and how it moves, from its sensors: an error-state Kalman filter in plain NumPy.

J. Sola, "Quaternion kinematics for the error-state Kalman filter" (2017), with the error of attitude in body axes.
Frames are ours: the world points east, north and up, the body forward, left and up. The error state has 15 numbers:
position, velocity, attitude, bias of the accelerometer, bias of the gyro.

Fixes and pressure come late. They are compared with where the filter says that the vehicle was then, and the present
error is related to the past one by what it has made of it meanwhile: of a position ``δp - τ δv``, of a velocity
``δv + τ R ([f]× δθ + δb)``, to first order in the delay τ.
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from aerial_il.control.vehicle import GRAVITY
from aerial_il.links.mavlink.frames import exponential, matrix, multiply, yaw_of

P, V, A, BA, BG = (slice(k, k + 3) for k in range(0, 15, 3))
SIZE = 15
DOWN = np.array([0.0, 0.0, -GRAVITY])
EYE = np.eye(3)
STILL_S = 1.0  # at rest, for finding where down and north are, and how the gyro errs


@dataclass(frozen=True)
class Tuning:
    """What the filter holds its sensors to be; standard deviations.

    Attributes:
        accel, gyro: white noise in m/s²/√Hz and rad/s/√Hz; above the sensors' own, because the thrust shakes both.
        accel_walk, gyro_walk: of the biases, per s, per √Hz. accel_bias, gyro_bias: at the start.
        heading: rad, of the magnetometer's. height: m, of the barometer's. fix_floor: m, the least of a fix.
        speed: m/s, of a fix. still_speed, still_rate: at rest, m/s and rad/s.
        pose, turn: m and rad, of motion capture's poses.
        gps_delay_s, baro_delay_s, pose_delay_s: how late they come.
    """

    accel: float = 0.01
    gyro: float = 4.0e-4
    accel_walk: float = 6.0e-3
    gyro_walk: float = 4.0e-5
    accel_bias: float = 0.06
    gyro_bias: float = 6.0e-3
    heading: float = 0.1
    height: float = 0.5
    fix_floor: float = 0.02
    speed: float = 0.08
    still_speed: float = 0.01
    still_rate: float = 5.0e-3
    pose: float = 2.0e-3
    turn: float = 5.0e-3
    gps_delay_s: float = 0.1
    baro_delay_s: float = 0.04
    pose_delay_s: float = 0.02


@dataclass(frozen=True)
class Estimate:
    """pos, vel: (3,) world, m and m/s. quat: (4,) world from base. angvel: (3,) base axes, rad/s."""

    pos: np.ndarray
    vel: np.ndarray
    quat: np.ndarray
    angvel: np.ndarray


class Estimator:
    """The filter. It stands still while it begins, until :attr:`ready`.

    Args:
        field: (3,) the earth's magnetic field, world. dt: s, of an IMU sample. tuning: see there.

    Attributes:
        ready: whether there is an estimate. covariance: (15, 15) of the error.
    """

    def __init__(self, field: np.ndarray, dt: float, tuning: Tuning | None = None) -> None:
        self.tuning, self._dt = tuning or Tuning(), dt
        self._north = math.atan2(field[1], field[0])
        self.ready = False
        self._still: list[np.ndarray] = []
        self._mag, self._fix = np.zeros(3), np.full(3, np.nan)
        self._pos, self._vel, self._quat = np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
        self._accel_bias, self._gyro_bias, self._rate = np.zeros(3), np.zeros(3), np.zeros(3)
        self._rot, self._force = np.eye(3), -DOWN
        self.covariance = np.zeros((SIZE, SIZE))
        longest = max(self.tuning.gps_delay_s, self.tuning.baro_delay_s, self.tuning.pose_delay_s)
        self._past: deque[np.ndarray] = deque(maxlen=1 + round(longest / dt))  # (2, 3) position and velocity, each
        noise = self.tuning
        walks = np.repeat([0.0, noise.accel, noise.gyro, noise.accel_walk, noise.gyro_walk], 3)
        self._process = np.diag(np.square(walks) * dt)

    @property
    def estimate(self) -> Estimate:
        """How things stand after the last sample."""
        return Estimate(self._pos, self._vel, self._quat, self._rate)

    def predict(self, accel: np.ndarray, gyro: np.ndarray) -> None:
        """Go on by one sample of the IMU: specific force (3,), m/s², and rate (3,), rad/s, body axes."""
        if not self.ready:
            return self._begin(accel, gyro)
        dt = self._dt
        self._rate = gyro - self._gyro_bias
        turn = exponential(dt * self._rate)
        self._quat = multiply(self._quat, turn)
        self._quat = self._quat / math.sqrt(float(self._quat @ self._quat))
        self._rot = rot = matrix(self._quat)
        self._force = accel - self._accel_bias
        acceleration = rot @ self._force + DOWN
        self._vel = self._vel + dt * acceleration
        self._pos = self._pos + dt * self._vel
        self._past.append(np.array([self._pos, self._vel]))
        step = np.eye(SIZE)
        step[P, V] = dt * EYE
        step[V, A], step[V, BA] = -dt * rot @ _skew(self._force), -dt * rot
        step[A, A], step[A, BG] = matrix(turn).T, -dt * EYE
        self.covariance = step @ self.covariance @ step.T + self._process
        return None

    def see_fix(self, pos: np.ndarray, vel: np.ndarray, spread: np.ndarray) -> None:
        """Take a fix of the receiver: position (3,) m, with its standard deviations (3,), and velocity (3,), m/s."""
        self._fix = pos
        if not self.ready:
            return
        past, delay = self._then(self.tuning.gps_delay_s)
        seen = np.zeros((6, SIZE))
        seen[:3, P], seen[:3, V] = EYE, -delay * EYE
        seen[3:, V], seen[3:, BA] = EYE, delay * self._rot
        seen[3:, A] = delay * self._rot @ _skew(self._force)
        deviations = [*np.maximum(spread, self.tuning.fix_floor), *[self.tuning.speed] * 3]
        self._correct(seen, np.concatenate([pos, vel]) - past.ravel(), np.array(deviations))

    def see_pose(self, pos: np.ndarray, heading: float) -> None:
        """Take a pose of motion capture: position (3,) m, and of its attitude the heading, rad."""
        self._fix = pos
        if not self.ready:
            return
        past, delay = self._then(self.tuning.pose_delay_s)
        seen = np.zeros((4, SIZE))
        seen[:3, P], seen[:3, V], seen[3, A] = EYE, -delay * EYE, self._rot[2]
        before = yaw_of(self._quat) - delay * float(self._rot[2] @ self._rate)
        wrong = [*(pos - past[0]), math.remainder(heading - before, 2.0 * math.pi)]
        self._correct(seen, np.array(wrong), np.array([*[self.tuning.pose] * 3, self.tuning.turn]))

    def see_height(self, height: float) -> None:
        """Take the barometer's height above the origin, m."""
        if not self.ready:
            return
        past, delay = self._then(self.tuning.baro_delay_s)
        seen = np.zeros((1, SIZE))
        seen[0, P.start + 2], seen[0, V.start + 2] = 1.0, -delay
        self._correct(seen, np.array([height - past[0, 2]]), np.array([self.tuning.height]))

    def see_field(self, mag: np.ndarray) -> None:
        """Take the magnetic field (3,), body axes: of it only the heading, lest iron nearby tilt the vehicle."""
        self._mag = mag
        if not self.ready:
            return
        level = self._rot @ mag
        seen = np.zeros((1, SIZE))
        seen[0, A] = self._rot[2]
        wrong = math.remainder(self._north - math.atan2(level[1], level[0]), 2.0 * math.pi)
        self._correct(seen, np.array([wrong]), np.array([self.tuning.heading]))

    def stand(self) -> None:
        """Take it that the vehicle is held: it neither moves nor turns."""
        if not self.ready:
            return
        seen = np.zeros((6, SIZE))
        seen[:3, V], seen[3:, BG] = EYE, -EYE
        deviations = np.repeat([self.tuning.still_speed, self.tuning.still_rate], 3)
        self._correct(seen, np.concatenate([-self._vel, -self._rate]), deviations)

    def _begin(self, accel: np.ndarray, gyro: np.ndarray) -> None:
        """Stand still for a while; then begin at the receiver's position, with down and north as they were felt."""
        self._still.append(np.concatenate([accel, gyro]))
        if len(self._still) * self._dt < STILL_S or np.isnan(self._fix).any() or not self._mag.any():
            return
        mean = np.mean(self._still, axis=0)
        up = mean[:3] / np.linalg.norm(mean[:3])
        roll, pitch = math.atan2(up[1], up[2]), math.asin(-max(-1.0, min(1.0, float(up[0]))))
        tilt = multiply(exponential(np.array([0.0, pitch, 0.0])), exponential(np.array([roll, 0.0, 0.0])))
        level = matrix(tilt) @ self._mag
        yaw = self._north - math.atan2(level[1], level[0])
        self._quat = multiply(exponential(np.array([0.0, 0.0, yaw])), tilt)
        self._pos, self._gyro_bias, self._rot = self._fix, mean[3:], matrix(self._quat)
        spread = [1.0, 0.1, self.tuning.accel_bias / GRAVITY, self.tuning.accel_bias, self.tuning.gyro_bias]
        self.covariance = np.diag(np.square(np.repeat(spread, 3)))
        self.covariance[A, A] += self.tuning.heading**2 * np.outer(self._rot[2], self._rot[2])
        self.ready = True

    def _then(self, delay_s: float) -> tuple[np.ndarray, float]:
        """Position and velocity (2, 3) of that long ago, or of the first moment, and how long ago that is, s."""
        back = min(round(delay_s / self._dt), len(self._past) - 1)
        if back < 0:
            return np.array([self._pos, self._vel]), 0.0
        return self._past[-1 - back], back * self._dt

    def _correct(self, seen: np.ndarray, wrong: np.ndarray, deviations: np.ndarray) -> None:
        """Kalman's update: ``seen`` (m, 15) of the error, innovation (m,), standard deviations (m,) of the noise."""
        crossed = self.covariance @ seen.T
        gain = np.linalg.solve(seen @ crossed + np.diag(np.square(deviations)), crossed.T).T
        kept = np.eye(SIZE) - gain @ seen
        self.covariance = kept @ self.covariance @ kept.T + (gain * np.square(deviations)) @ gain.T  # Joseph's form
        self._inject(gain @ wrong)

    def _inject(self, error: np.ndarray) -> None:
        """Add the error to the estimate, and to what it was in the past; what is left of it is zero."""
        count = len(self._past)
        for k, past in enumerate(self._past):
            past[0] += error[P] - (count - 1 - k) * self._dt * error[V]
            past[1] += error[V]
        self._pos, self._vel = self._pos + error[P], self._vel + error[V]
        self._quat = multiply(self._quat, exponential(error[A]))
        self._rot = matrix(self._quat)
        self._accel_bias, self._gyro_bias = self._accel_bias + error[BA], self._gyro_bias + error[BG]
        self._rate = self._rate - error[BG]


def _skew(vector: np.ndarray) -> np.ndarray:
    """Matrix (3, 3) of the cross product with a vector."""
    x, y, z = vector.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
