"""Numbers of MAVLink and of PX4 that both ends of a wire use, and the message that carries an arm's encoders."""

from typing import Any

import numpy as np

from aerial_il.links.link import LinkError
from aerial_il.links.mavlink.wire import dialect

SIMULATOR_PORT, CLIENT_PORT = 4560, 14540  # PX4's, of its simulators and of offboard clients
SIMULATOR, AUTOPILOT, COMPANION = (1, 200), (1, 1), (1, 191)  # system and component
OFFBOARD, AUTO, LOITER = 6, 4, 3  # PX4's custom modes: main modes, and a sub-mode of AUTO
IMU_FIELDS, MAG_FIELDS, BARO_FIELDS = 0x3F, 0x1C0, 0x1A00  # of HIL_SENSOR.fields_updated
LEVELS = ("base_joint", "velocity", "ctbr")  # of set points
FLOATS = 58  # of a DEBUG_FLOAT_ARRAY


def joints_message(time_us: int, joints: np.ndarray, speeds: np.ndarray, opening: float) -> Any:
    """DEBUG_FLOAT_ARRAY ``joints``: positions (J,) rad, speeds (J,) rad/s, opening of the gripper in [0, 1].

    No message of the common set is made for arms; this one carries named numbers, and whoever does not know the name
    passes it over. Its ``array_id`` is J.
    """
    numbers = [*map(float, joints), *map(float, speeds), float(opening)]
    return dialect().MAVLink_debug_float_array_message(
        time_us, b"joints", joints.size, [*numbers, *[0.0] * (FLOATS - len(numbers))]
    )


def joints_of(message: Any, count: int) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Positions (J,), speeds (J,) and opening of a message; None of another.

    Raises:
        LinkError: they are of an arm with other joints.
    """
    if message.get_type() != "DEBUG_FLOAT_ARRAY" or message.name != "joints":
        return None
    if message.array_id != count:
        raise LinkError(f"An arm of {message.array_id} joints answers, and {count} were expected: it is another robot.")
    numbers = np.array(message.data)
    return numbers[:count], numbers[count : 2 * count], float(numbers[2 * count])
