"""A stand-in for an autopilot: from the simulator's sensors to an estimate, to our flight controller, to the rotors.

It is at the wire's other end where a PX4 would be, and speaks as PX4 does to the simulator and to an offboard client.
It is not PX4: neither its estimator nor its controller nor its mixer, which flies canted rotors that PX4's does not.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aerial_il.control import controller_state as layout
from aerial_il.control.controller import Controller
from aerial_il.control.vehicle import GRAVITY, Vehicle
from aerial_il.links.link import QUIET_S, LinkError, Mode
from aerial_il.links.mavlink.channels import THRUST_CURVE, Channels, RotorLag
from aerial_il.links.mavlink.commander import Commander
from aerial_il.links.mavlink.estimator import Estimate, Estimator
from aerial_il.links.mavlink.frames import Home, altitude_at, swap_attitude, swap_body, swap_world, yaw_of
from aerial_il.links.mavlink.simulator import AUTOPILOT, MAG_FIELDS, PORT, STEP_US, joints_message, joints_of
from aerial_il.links.mavlink.wire import PATIENCE_S, HungUpError, Wire, accept, connect, datagrams, dialect, listen
from aerial_il.suite.timing import PHYSICS_DT_S, SUBSTEPS

CLIENT_PORT = 14540  # PX4's for offboard clients
BARO_FIELD = 0x200
STAND_EVERY = 10  # samples between two reminders that it does not move
SPIN_UP_S, SPIN_UP_SHARE = 0.3, 0.8  # before it takes off: share of the weight
LEVELS = ("base_joint", "velocity", "ctbr")
HEARTBEAT_EVERY = 250  # samples


class Flight:
    """Our flight controller at several levels, between which it changes in the air.

    Args:
        vehicle: nominal model. law: name of the flight law.
    """

    def __init__(self, vehicle: Vehicle, law: str = "geometric_observer") -> None:
        self._vehicle, self._lag = vehicle, RotorLag(vehicle, PHYSICS_DT_S)
        self._controllers = {level: Controller(vehicle, level=level, law=law) for level in LEVELS}
        self._hover = vehicle.mixer[:, 2] * vehicle.mass * GRAVITY
        self.stop()
        now = Estimate(np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3))
        for level in LEVELS:  # compiled before time counts
            self.fly(level, np.zeros(4), now, vehicle.rest_down, 1.0, vehicle.rest_down, np.zeros(vehicle.num_joints))
        self.stop()

    def stop(self) -> None:
        """Forget the flight."""
        for controller in self._controllers.values():
            controller.reset()
        self._level, self._spinning = "base_joint", round(SPIN_UP_S / PHYSICS_DT_S)
        self._lag.thrust = np.zeros(self._vehicle.num_rotors)

    @property
    def joints(self) -> np.ndarray:
        """(J,) set points of the servos, rad."""
        first = layout.JOINT_CMD
        return self._controllers[self._level].state[first : first + self._vehicle.num_joints]

    def fly(
        self,
        level: str,
        base: np.ndarray,
        now: Estimate,
        posture: np.ndarray,
        opening: float,
        joints: np.ndarray,
        speeds: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return thrusts (R,) N and joint set points (J,) rad for the next 4 ms.

        Args:
            level: of ``LEVELS``. base: (4,) what it asks of the base. now: the estimate.
            posture, opening: set points of arm and gripper. joints, speeds: (J,) of the arm, as measured.
        """
        if self._spinning:
            self._spinning -= 1
            thrust, held = SPIN_UP_SHARE * self._hover, joints
        else:
            self._change(level, now)
            controller = self._controllers[level]
            arm = self._rates_to(posture) if level == "velocity" else posture
            action = np.array([*base, *arm, *([opening] if self._vehicle.gripper_stroke else [])])
            qpos = np.concatenate([now.pos, now.quat, joints])
            qvel = np.concatenate([now.vel, now.angvel, speeds])
            thrust, _ = controller.update(action, qpos, qvel, self._lag.thrust)
            held = self.joints
        self._lag.follow(thrust)
        return thrust, held

    def _rates_to(self, posture: np.ndarray) -> np.ndarray:
        speed = self._vehicle.joint_speed
        return np.clip((posture - self.joints) / (PHYSICS_DT_S * SUBSTEPS), -speed, speed)

    def _change(self, level: str, now: Estimate) -> None:
        """Go on at another level, the base's reference where the base is."""
        if level == self._level:
            return
        state = self._controllers[level].state
        state[:] = self._controllers[self._level].state
        state[layout.BASE_POS : layout.BASE_POS + 3], state[layout.BASE_YAW] = now.pos, yaw_of(now.quat)
        state[layout.BASE_VEL : layout.BASE_VEL + 3], state[layout.BASE_YAW_RATE] = now.vel, 0.0
        self._level = level


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
        simulator: tuple[str, int] = ("127.0.0.1", PORT),
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
        if message.fields_updated & BARO_FIELD:
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
        common, commander, now = dialect(), self.commander, self.estimator.estimate
        ms = self._time_us // 1000
        messages = []
        if (state := (commander.mode, commander.armed)) != self._told or self._samples % HEARTBEAT_EVERY == 0:
            self._told = state
            messages += self._heartbeat()
        pos, vel = swap_world(now.pos), swap_world(now.vel)
        return [
            *messages,
            common.MAVLink_local_position_ned_message(ms, *map(float, [*pos, *vel])),
            common.MAVLink_attitude_quaternion_message(
                ms, *map(float, [*swap_attitude(now.quat), *swap_body(now.angvel)])
            ),
            joints_message(self._time_us, np.array([*self._joints, *self._speeds, self._opening])),
            common.MAVLink_timesync_message(0, 1000 * self._time_us),  # asks for an answer
        ]

    def _heartbeat(self) -> list[Any]:
        common, commander = dialect(), self.commander
        base = common.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        base |= common.MAV_MODE_FLAG_SAFETY_ARMED if commander.armed else 0
        status = common.MAV_STATE_STANDBY if commander.mode is Mode.STANDING else common.MAV_STATE_ACTIVE
        landed = {
            Mode.STANDING: common.MAV_LANDED_STATE_ON_GROUND,
            Mode.TAKING_OFF: common.MAV_LANDED_STATE_TAKEOFF,
            Mode.LANDING: common.MAV_LANDED_STATE_LANDING,
        }.get(commander.mode, common.MAV_LANDED_STATE_IN_AIR)
        kind = common.MAV_TYPE_HEXAROTOR if self._channels.rotors == 6 else common.MAV_TYPE_QUADROTOR
        return [
            common.MAVLink_heartbeat_message(
                kind, common.MAV_AUTOPILOT_GENERIC, base, commander.custom_mode, status, 3
            ),
            common.MAVLink_extended_sys_state_message(common.MAV_VTOL_STATE_UNDEFINED, landed),
        ]
