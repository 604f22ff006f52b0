"""The suite as the simulator that a PX4 in SITL expects: a TCP server, in lockstep with the autopilot.

Each 4 ms it sends HIL_SENSOR, and HIL_GPS or VISION_POSITION_ESTIMATE when one is due, then waits for
HIL_ACTUATOR_CONTROLS. ``DEBUG_FLOAT_ARRAY`` carries the arm's encoders, see :mod:`aerial_il.links.mavlink.protocol`.

No PX4 has been run with it, only the stand-in of :mod:`aerial_il.links.mavlink.autopilot`.
"""

import logging
import math
import threading
from typing import Any

import numpy as np

from aerial_il.links.link import LinkError
from aerial_il.links.mavlink.channels import CHANNELS
from aerial_il.links.mavlink.frames import altitude_at, matrix, swap_attitude, swap_body, swap_world
from aerial_il.links.mavlink.protocol import (
    BARO_FIELDS,
    IMU_FIELDS,
    MAG_FIELDS,
    SIMULATOR,
    SIMULATOR_PORT,
    joints_message,
)
from aerial_il.links.mavlink.sensors import Fix, Gps, Pose, Sensed, Sensors
from aerial_il.links.mavlink.wire import PATIENCE_S, HungUpError, Wire, accept, dialect, listen, shut
from aerial_il.links.mavlink.world import CradledWorld
from aerial_il.suite.timing import PHYSICS_DT_S
from aerial_il.teleop.session.clock import Metronome

START_US = 10_000_000  # of its clock
STEP_US = round(1e6 * PHYSICS_DT_S)
ROOM_C = 20.0

log = logging.getLogger(__name__)


class Simulator:
    """One robot of the suite for one autopilot.

    Args:
        world: what it flies in. sensors: what it carries. host, port: where the autopilot connects; 0 for a free port.
        truth: send HIL_STATE_QUATERNION, too. speed: of its time against the wall's; 0: as fast as the autopilot.
        boot: keep sending until the autopilot answers for the first time, as PX4 asks for; else the first answer is
            waited for as all others are, and equal flights are equal bit for bit. patience_s: with an answer.

    Attributes:
        port: where it listens. steps: of 4 ms, since the start. ended: set it to end :meth:`run`.

    Raises:
        LinkError: the port is in use.
    """

    def __init__(
        self,
        world: CradledWorld,
        sensors: Sensors | None = None,
        *,
        host: str = "127.0.0.1",
        port: int = SIMULATOR_PORT,
        truth: bool = False,
        speed: float = 0.0,
        boot: bool = False,
        patience_s: float = PATIENCE_S,
    ) -> None:
        self.world, self.sensors = world, sensors or Sensors()
        dialect()
        self._server = listen(host, port)
        self.port: int = self._server.getsockname()[1]
        self._truth, self._booting, self._patience_s = truth, boot, patience_s
        self._metronome = Metronome(PHYSICS_DT_S / speed) if speed else None
        self._boot_pace = Metronome(PHYSICS_DT_S)
        self._wire: Wire | None = None
        self._controls, self._armed, self._answered_us = np.zeros(CHANNELS), False, 0
        self.steps = 0
        self.ended = threading.Event()

    @property
    def time_us(self) -> int:
        """Its clock."""
        return START_US + self.steps * STEP_US

    def run(self) -> None:
        """Wait for the autopilot and fly until it hangs up, or :attr:`ended` is set.

        Raises:
            LinkError: nobody connects, or the autopilot falls silent or lets its clock jump back.
        """
        self._wire = self._wire or Wire(
            accept(self._server, "The autopilot", self._patience_s), *SIMULATOR, "The autopilot", self._patience_s
        )
        while not self.ended.is_set():
            try:
                self.step()
            except HungUpError:
                log.debug("The autopilot hung up after %.1f s.", self.steps * PHYSICS_DT_S)
                return

    def step(self) -> None:
        """Show the sensors, wait for the controls, and go on by 4 ms."""
        assert self._wire is not None
        self._wire.send(*self._messages(self.sensors.read(self.world.motion)))
        self._listen(self._wire)
        self.world.step(self._controls, self._armed)
        self.steps += 1
        if self._metronome:
            self._metronome.wait()

    def hang_up(self) -> None:
        """Let :meth:`run` end wherever it waits; for another thread."""
        self.ended.set()
        shut(self._server)
        if self._wire:
            self._wire.hang_up()

    def close(self) -> None:
        """Hang up, and free the port and the world."""
        if self._wire:
            self._wire.close()
        self._server.close()
        self.world.close()

    def _listen(self, wire: Wire) -> None:
        if self._booting:
            self._boot_pace.wait()
            for message in wire.poll():
                self._obey(message)
            return
        for message in wire.wait_for("HIL_ACTUATOR_CONTROLS"):
            self._obey(message)

    def _obey(self, message: Any) -> None:
        if message.get_type() != "HIL_ACTUATOR_CONTROLS":
            return
        if message.time_usec < self._answered_us:
            raise LinkError(f"The autopilot's clock jumped back, from {self._answered_us} to {message.time_usec} µs.")
        if not np.isfinite(message.controls[: self.world.channels.rotors]).all():
            raise LinkError("The autopilot sent controls that are not finite.")
        self._booting, self._answered_us = False, message.time_usec
        self._controls = np.nan_to_num(np.array(message.controls))
        self._armed = bool(message.mode & dialect().MAV_MODE_FLAG_SAFETY_ARMED)

    def _messages(self, sensed: Sensed) -> list[Any]:
        world = self.world
        messages = [joints_message(self.time_us, world.joints, world.joint_speeds, world.opening)]
        if sensed.fix is not None and self.sensors.gps is not None:
            messages.append(self._fix(sensed.fix, self.sensors.gps))
        if sensed.pose is not None:
            messages.append(self._pose(sensed.pose))
        if self._truth:
            messages.append(self._true_state())
        return [*messages, self._sensor(sensed)]

    def _sensor(self, sensed: Sensed) -> Any:
        mag = np.zeros(3) if sensed.mag is None else sensed.mag
        fields = IMU_FIELDS | (MAG_FIELDS if sensed.mag is not None else 0)
        fields |= BARO_FIELDS if sensed.pressure is not None else 0
        pressure = sensed.pressure or 0.0
        altitude = altitude_at(pressure) if pressure else 0.0
        values = [*sensed.accel, *sensed.gyro, *mag, 0.01 * pressure, 0.0, altitude, ROOM_C]
        return dialect().MAVLink_hil_sensor_message(self.time_us, *map(float, values), fields, 0)

    def _pose(self, pose: Pose) -> Any:
        """VISION_POSITION_ESTIMATE: position, and roll, pitch and yaw of forward-right-down in north-east-down."""
        north, east, down = map(float, swap_world(pose.pos))
        rot = matrix(swap_attitude(pose.quat))
        roll, pitch = math.atan2(rot[2, 1], rot[2, 2]), -math.asin(max(-1.0, min(1.0, float(rot[2, 0]))))
        angles = roll, pitch, math.atan2(rot[1, 0], rot[0, 0])
        return dialect().MAVLink_vision_position_estimate_message(
            self.time_us, north, east, down, *angles, [math.nan] * 21
        )

    def _fix(self, fix: Fix, gps: Gps) -> Any:
        lat, lon, alt = self.sensors.home.geodetic(fix.pos)
        eph, epv = (round(100.0 * np.hypot(noise, drift)) for noise, drift in zip(gps.noise, gps.drift, strict=True))
        north, east, down = (round(100.0 * float(v)) for v in swap_world(fix.vel))
        speed = round(float(np.hypot(north, east)))
        where = round(1e7 * lat), round(1e7 * lon), round(1e3 * alt)
        unknown = 65535
        return dialect().MAVLink_hil_gps_message(
            self.time_us, gps.fix_type, *where, max(1, eph), max(1, epv), speed, north, east, down, unknown, 12
        )

    def _true_state(self) -> Any:
        motion = self.world.motion
        lat, lon, alt = self.sensors.home.geodetic(motion.pos)
        where = round(1e7 * lat), round(1e7 * lon), round(1e3 * alt)
        velocity = [round(100.0 * float(v)) for v in swap_world(motion.vel)]
        felt = [round(1000.0 / 9.80665 * float(v)) for v in swap_body(motion.specific_force)]
        return dialect().MAVLink_hil_state_quaternion_message(
            self.time_us, swap_attitude(motion.quat).tolist(), *map(float, swap_body(motion.angvel)), *where, *velocity,
            0, 0, *(max(-32768, min(32767, each)) for each in felt),
        )  # fmt: skip
