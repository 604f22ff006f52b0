"""The wire's frames and ours. MAVLink: north-east-down and forward-right-down; here: east-north-up, forward-left-up.

Each swap is its own inverse. Quaternions are (w, x, y, z), world from body.
"""

import math
from dataclasses import dataclass

import numpy as np

EARTH_RADIUS_M = 6_371_000.0  # of the sphere on which PX4 projects
_SEA_LEVEL_PA, _LAPSE_PER_M, _EXPONENT = 101_325.0, 2.25577e-5, 5.25588  # International Standard Atmosphere


@dataclass(frozen=True)
class Home:
    """Where the world's origin lies on the earth.

    Attributes:
        lat_deg, lon_deg: WGS84, degrees. alt_m: above mean sea level; defaults are those of PX4's simulations.
        field_gauss: (3,) the earth's magnetic field there, north, east, down.
    """

    lat_deg: float = 47.397742
    lon_deg: float = 8.545594
    alt_m: float = 488.0
    field_gauss: tuple[float, float, float] = (0.2148, 0.0113, 0.4300)

    def geodetic(self, pos: np.ndarray) -> tuple[float, float, float]:
        """Latitude and longitude (degrees) and altitude (m) of a position (3,) east, north, up."""
        north = math.degrees(pos[1] / EARTH_RADIUS_M)
        east = math.degrees(pos[0] / (EARTH_RADIUS_M * math.cos(math.radians(self.lat_deg))))
        return self.lat_deg + north, self.lon_deg + east, self.alt_m + float(pos[2])

    def local(self, lat_deg: float, lon_deg: float, alt_m: float) -> np.ndarray:
        """Position (3,) east, north, up, m; the inverse of :meth:`geodetic`."""
        east = EARTH_RADIUS_M * math.cos(math.radians(self.lat_deg)) * math.radians(lon_deg - self.lon_deg)
        north = EARTH_RADIUS_M * math.radians(lat_deg - self.lat_deg)
        return np.array([east, north, alt_m - self.alt_m])


def swap_world(vector: np.ndarray) -> np.ndarray:
    """North-east-down (3,) of east-north-up, and back."""
    return np.array([vector[1], vector[0], -vector[2]])


def swap_body(vector: np.ndarray) -> np.ndarray:
    """Forward-right-down (3,) of forward-left-up, and back."""
    return np.array([vector[0], -vector[1], -vector[2]])


def swap_attitude(quat: np.ndarray) -> np.ndarray:
    """Quaternion (4,) between the wire's frames of one between ours, and back."""
    half = math.sqrt(0.5)
    return multiply(multiply(np.array([0.0, half, half, 0.0]), quat), np.array([0.0, 1.0, 0.0, 0.0]))


def swap_yaw(yaw: float) -> float:
    """Heading from north, clockwise, of one from east, counter-clockwise, and back; rad in (-π, π]."""
    return math.remainder(0.5 * math.pi - yaw, 2.0 * math.pi)


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Product (4,) of two quaternions."""
    (aw, ax, ay, az), (bw, bx, by, bz) = a.tolist(), b.tolist()
    return np.array(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ]
    )


def matrix(quat: np.ndarray) -> np.ndarray:
    """Rotation matrix (3, 3) of a unit quaternion."""
    w, x, y, z = quat.tolist()
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


def exponential(rotvec: np.ndarray) -> np.ndarray:
    """Unit quaternion (4,) of a rotation vector (3,), rad."""
    angle = math.sqrt(float(rotvec @ rotvec))
    share = 0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle
    return np.array([math.cos(0.5 * angle), *(share * rotvec)])


def yaw_of(quat: np.ndarray) -> float:
    """Heading of the x axis from the world's x axis, rad."""
    w, x, y, z = quat.tolist()
    return math.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))


def pressure_at(alt_m: float) -> float:
    """Pressure, Pa, at an altitude above mean sea level."""
    return _SEA_LEVEL_PA * (1.0 - _LAPSE_PER_M * alt_m) ** _EXPONENT


def altitude_at(pressure_pa: float) -> float:
    """Altitude above mean sea level, m; the inverse of :func:`pressure_at`."""
    return (1.0 - (pressure_pa / _SEA_LEVEL_PA) ** (1.0 / _EXPONENT)) / _LAPSE_PER_M
