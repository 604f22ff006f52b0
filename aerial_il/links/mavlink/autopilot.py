"""A stand-in for an autopilot: from the simulator's sensors to an estimate, to our flight controller, to the rotors.

It is at the wire's other end where a PX4 would be, and speaks as PX4 does to the simulator and to an offboard client.
It is not PX4: neither its estimator nor its controller nor its mixer, which flies canted rotors that PX4's does not.
"""

from typing import Any

import numpy as np

from aerial_il.control.vehicle import Vehicle
from aerial_il.links.link import QUIET_S, LinkError, Mode
from aerial_il.links.mavlink.channels import THRUST_CURVE, Channels
from aerial_il.links.mavlink.commander import Commander
from aerial_il.links.mavlink.estimator import Estimator
from aerial_il.links.mavlink.flight import Flight
from aerial_il.links.mavlink.frames import Home, altitude_at, swap_body, swap_world, swap_yaw
from aerial_il.links.mavlink.protocol import (
    AUTOPILOT,
    BARO_FIELDS,
    CLIENT_PORT,
    MAG_FIELDS,
    SIMULATOR_PORT,
    joints_of,
)
from aerial_il.links.mavlink.telemetry import VehicleState, mode_messages, state_messages
from aerial_il.links.mavlink.wire import (
    PATIENCE_S,
    HungUpError,
    Wire,
    accept,
    connect,
    datagrams,
    dialect,
    listen,
    shut,
)
from aerial_il.suite.timing import PHYSICS_DT_S, SUBSTEPS

STEP_US = round(1e6 * PHYSICS_DT_S)
STAND_EVERY, HEARTBEAT_EVERY = 10, 250  # samples


class Autopilot:
    """The stand-in.

    Args:
        vehicle: nominal model of what it flies. simulator: host and port. client: host and port of whoever commands:
            where set points come from by UDP, or, in lockstep, where it is served by TCP (port 0: any free one).
        lockstep: wait for the client's answer to each telemetry (50 Hz). law: flight law. home, curve: as the
            simulator's. quiet_s: without a set point for longer, it holds.

    Attributes:
        port: where the client connects, in lockstep.

    Raises:
        LinkError: the port is in use.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        *,
        simulator: tuple[str, int] = ("127.0.0.1", SIMULATOR_PORT),
        client: tuple[str, int] = ("127.0.0.1", CLIENT_PORT),
        lockstep: bool = False,
        law: str = "geometric_observer",
        home: Home | None = None,
        curve: float = THRUST_CURVE,
        quiet_s: float = QUIET_S,
        patience_s: float = PATIENCE_S,
    ) -> None:
        dialect()
        self.home, self._patience_s = home or Home(), patience_s
        self._joint_count, self._lockstep = vehicle.num_joints, lockstep
        self._simulator, self._client_address = simulator, client
        self._server = listen(*client) if lockstep else None
        self.port: int = self._server.getsockname()[1] if self._server else client[1]
        self._channels = Channels(vehicle, curve)
        self.commander = Commander(vehicle, self._channels, self.home, quiet_s)
        self.estimator = Estimator(swap_world(np.array(self.home.field_gauss)), PHYSICS_DT_S)
        self._flight = Flight(vehicle, law)
        self._joints, self._speeds, self._opening = vehicle.rest_down, np.zeros(vehicle.num_joints), 1.0
        self._time_us, self._samples, self._told = 0, 0, (Mode.CRASHED, False)
        self._client: Wire | None = None
        self._wire: Wire | None = None

    def run(self) -> None:
        """Fly until the simulator hangs up, or the client does in lockstep.

        Raises:
            LinkError: an end is missing or silent, or the simulator's clock stands still or jumps.
        """
        try:
            self._client = self._meet_client()
            self._wire = Wire(connect(*self._simulator, "The simulator"), *AUTOPILOT, "The simulator", self._patience_s)
            while True:
                for message in self._wire.wait_for("HIL_SENSOR"):
                    self._sense(message)
                self._wire.send(self._controls())
        except HungUpError:
            return
        finally:
            self.close()

    def hang_up(self) -> None:
        """Let :meth:`run` end wherever it waits; for another thread."""
        shut(self._server)
        for end in (self._wire, self._client):
            if end is not None:
                end.hang_up()

    def close(self) -> None:
        """Hang up at both ends."""
        for end in (self._wire, self._client, self._server):
            if end is not None:
                end.close()

    def _meet_client(self) -> Wire:
        if self._server:
            return Wire(
                accept(self._server, "The client", self._patience_s), *AUTOPILOT, "The client", self._patience_s
            )
        wire = Wire(datagrams("0.0.0.0", 0), *AUTOPILOT, "The client", self._patience_s)
        wire.call(self._client_address)
        return wire

    def _sense(self, message: Any) -> None:
        name = message.get_type()
        if (encoders := joints_of(message, self._joint_count)) is not None:
            self._joints, self._speeds, self._opening = encoders
        elif name == "HIL_GPS" and message.fix_type >= 3:
            pos = self.home.local(1e-7 * message.lat, 1e-7 * message.lon, 1e-3 * message.alt)
            vel = swap_world(0.01 * np.array([message.vn, message.ve, message.vd]))
            self.estimator.see_fix(pos, vel, 0.01 * np.array([message.eph, message.eph, message.epv]))
        elif name == "VISION_POSITION_ESTIMATE":
            pos = swap_world(np.array([message.x, message.y, message.z]))
            self.estimator.see_pose(pos, swap_yaw(message.yaw))
        elif name == "HIL_SENSOR":
            self._feel(message)

    def _feel(self, message: Any) -> None:
        if self._time_us and message.time_usec - self._time_us != STEP_US:
            raise LinkError(
                f"The simulator's clock went from {self._time_us} to {message.time_usec} µs: it must go on by "
                f"{STEP_US} µs from one HIL_SENSOR to the next."
            )
        self._time_us = message.time_usec
        self._samples += 1
        estimator = self.estimator
        accel = swap_body(np.array([message.xacc, message.yacc, message.zacc]))
        estimator.predict(accel, swap_body(np.array([message.xgyro, message.ygyro, message.zgyro])))
        if message.fields_updated & MAG_FIELDS:
            estimator.see_field(swap_body(np.array([message.xmag, message.ymag, message.zmag])))
        if message.fields_updated & BARO_FIELDS:
            estimator.see_height(altitude_at(100.0 * message.abs_pressure) - self.home.alt_m)
        if self.commander.mode is Mode.STANDING and self._samples % STAND_EVERY == 0:
            estimator.stand()

    def _controls(self) -> Any:
        """Hear the client out, and return the controls of the next 4 ms."""
        commander = self.commander
        if self.estimator.ready:
            commander.know(1e-6 * self._time_us, self.estimator.estimate, self._joints, self._opening)
            self._converse()
        wanted = commander.wanted()
        controls = np.zeros(self._channels.rotors)
        joints = self._joints
        if wanted is None:
            self._flight.stop()
        else:
            level, base = wanted
            arm = commander.joints, commander.opening, self._joints, self._speeds
            controls, joints = self._flight.fly(level, base, self.estimator.estimate, *arm)
        armed = dialect().MAV_MODE_FLAG_SAFETY_ARMED if commander.armed else 0
        return dialect().MAVLink_hil_actuator_controls_message(
            self._time_us, self._channels.controls(controls, joints, commander.opening).tolist(), armed, 1
        )

    def _converse(self) -> None:
        """Tell the client how things stand, 50 times a second, and take what it says."""
        assert self._client is not None
        due = self._samples % SUBSTEPS == 0
        if due:
            self._client.send(*self._telemetry())
        messages = self._client.wait_for("TIMESYNC") if due and self._lockstep else self._client.poll()
        for message in messages:
            if answers := self.commander.obey(message):
                self._client.send(*answers)

    def _telemetry(self) -> list[Any]:
        commander, now = self.commander, self.estimator.estimate
        arm = self._joints, self._speeds, self._opening
        stands = now.pos, now.vel, now.quat, now.angvel, *arm, commander.armed, commander.mode
        state = VehicleState(1e-6 * self._time_us, *stands)
        modes = mode_messages(state, self._channels.rotors)
        new, self._told = (state.mode, state.armed) != self._told, (state.mode, state.armed)
        question = dialect().MAVLink_timesync_message(0, 1000 * self._time_us)
        beat = modes if new or self._samples % HEARTBEAT_EVERY == 0 else []
        return [*beat, *state_messages(state), question]
