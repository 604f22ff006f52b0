"""A simulated robot as a node of ROS 2: it shows its state, takes set points and obeys orders, in real time.

State that belongs together carries one stamp, of the robot's clock. What is named here is relative to the namespace.
"""

import json
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.core.rotations import mat_from_rot6d
from aerial_il.core.specs import Field
from aerial_il.links.link import Mode, Order, Reading, RefusedError
from aerial_il.links.robot import TAKE_OFF_M, SimulatedRobot
from aerial_il.links.ros2 import exact, messages
from aerial_il.links.ros2.exact import NAMESPACE, NUMBERS
from aerial_il.links.ros2.middleware import Served, lasting, ros
from aerial_il.links.ros2.set_points import Now, SetPoints
from aerial_il.teleop.session.clock import Metronome, Pace

FLAGS = ("armed", "success", "crash")  # topics of their own
LARGE = ("state", "ctrl")  # of a simulator, which are not shown
LISTEN_S = 1.0  # for another robot on the namespace, before it is taken
SET_DEPTH = 5  # set points that wait: all that arrive between two ticks


class RobotNode:
    """A robot on a namespace.

    Args:
        robot: what is shown and flown; it is stepped here alone. namespace: of topics and services.
        speed: robot's seconds in a second. clock: whether it publishes ``/clock``, which all robots share.

    Raises:
        InvalidValueError: ROS 2 is not installed, the namespace or the speed is none, or another robot is there.
    """

    def __init__(
        self, robot: SimulatedRobot, *, namespace: str = NAMESPACE, speed: float = 1.0, clock: bool = True
    ) -> None:
        if not 0.0 < speed <= 100.0:
            raise InvalidValueError(f"link.speed is {speed:g}; it must lie in (0, 100].")
        self._robot, self._lock = robot, threading.Lock()
        self._actions = {level: robot.spec_at(level).action for level in robot.levels}
        self._parts = SetPoints(self._actions)
        self._metronome_s = robot.spec.control_dt_s / speed
        self._pace = Pace(0.0, 1.0, 0, 0)
        self._refused: dict[str, int] = {}  # how many set points, by their topics
        self._logged: set[str] = set()
        self._mode = robot.mode
        self._served = Served("robot", namespace)
        self._node = self._served.node
        self._require_alone()
        self._publishers: dict[str, Any] = {}
        self._said: dict[str, Any] = {}
        self._clock = self._node.create_publisher(ros().Clock, "/clock", 1) if clock else None
        for order, (_, parameter) in NUMBERS.items():
            self._node.declare_parameter(parameter, TAKE_OFF_M if order is Order.TAKE_OFF else 0)
        self._say("description", ros().String, json.dumps(description(robot, speed)))
        self._subscribe()
        for order in Order:
            self._node.create_service(ros().Trigger, order.value, partial(self._obey, order))
        self._served.start()

    @property
    def pace(self) -> Pace:
        """How well :meth:`run` keeps time."""
        return self._pace

    def run(self, until: Callable[[], bool] = lambda: False) -> None:
        """Tick in real time, times the speed, until ``until`` says so."""
        metronome = Metronome(self._metronome_s)
        while not until():
            metronome.wait()
            self.tick()
            self._pace = metronome.pace

    def tick(self) -> None:
        """Let 20 ms pass, and show what came of it."""
        with self._lock:
            if (composed := self._parts.compose(self._robot.time_s)) is not None:
                self._robot.command(*composed)
            self._robot.tick()
            if self._robot.mode not in (self._mode, Mode.FLYING):
                self._parts.forget()
            self._mode = self._robot.mode
            self._show(self._robot.reading())

    def close(self) -> None:
        """Leave the middleware; the robot is its owner's to close."""
        self._served.close()

    def _require_alone(self) -> None:
        """Refuse a namespace on which another robot is heard."""
        end = time.monotonic() + LISTEN_S
        while time.monotonic() < end:
            if self._node.count_publishers("description"):
                namespace = self._node.get_namespace()
                self.close()
                raise InvalidValueError(f"A robot is on {namespace} already. Choose another: link.namespace=/NAME.")
            time.sleep(0.05)

    def _subscribe(self) -> None:
        takers: dict[str, tuple[Any, Callable[[Any], None]]] = {
            "action": (ros().JointState, self._take_action),
            "tool_pose": (ros().PoseStamped, self._take_tool),
            "base_pose": (ros().PoseStamped, self._take_base),
            "base_trajectory": (ros().MultiDOFJointTrajectory, self._take_base_way),
            "base_velocity": (ros().TwistStamped, self._take_velocity),
            "arm": (ros().JointTrajectory, self._take_arm),
            "gripper": (ros().Float64, self._take_gripper),
        }
        for name, (kind, take) in takers.items():
            self._node.create_subscription(kind, f"set/{name}", partial(self._take, name, take), SET_DEPTH)

    def _take(self, name: str, take: Callable[[Any], None], message: Any) -> None:
        """Take a set point, or refuse it: counted, and logged once for each of its reasons."""
        try:
            with self._lock:
                take(message)
        except AerialError as error:
            reason = f"set/{name} is refused: {error}"
            if reason not in self._logged:
                self._node.get_logger().warning(reason)
            self._logged.add(reason)
            self._refused[name] = self._refused.get(name, 0) + 1

    def _take_action(self, message: Any) -> None:
        labels = tuple(message.name)
        for level, spec in self._actions.items():
            if labels == spec.labels and len(message.position) == spec.size:
                self._robot.command(level, np.array(message.position))
                return self._parts.take_action(np.array(message.position))
        valid = "; ".join(f"{level}: {', '.join(spec.labels)}" for level, spec in self._actions.items())
        raise RefusedError(f"no level has these numbers in this order: {', '.join(labels)}. Valid: {valid}.")

    def _take_tool(self, message: Any) -> None:
        _require_world(message.header)
        self._parts.take_tool(np.concatenate(messages.pose_of(message.pose)), self._now())

    def _take_base(self, message: Any) -> None:
        _require_world(message.header)
        self._parts.take_base(np.zeros(1), _pos_yaw(message.pose)[None], self._now())

    def _take_base_way(self, message: Any) -> None:
        _require_world(message.header)
        if any(len(point.transforms) != 1 for point in message.points):
            raise RefusedError("each point needs one transform, of the base.")
        points = np.array([_pos_yaw(point.transforms[0]) for point in message.points]).reshape(-1, 4)
        self._parts.take_base(_times(message), points, self._now())

    def _take_velocity(self, message: Any) -> None:
        _require_world(message.header)
        twist = message.twist
        self._parts.take_velocity(np.append(messages.vector_of(twist.linear), twist.angular.z), self._now())

    def _take_arm(self, message: Any) -> None:
        names = messages.joint_names(self._parts.joints)
        if sorted(message.joint_names) != names:
            given = ", ".join(message.joint_names)
            raise RefusedError(f"the arm's joints are {', '.join(names) or 'none'}; got {given or 'none'}.")
        if any(len(point.positions) != len(names) for point in message.points):
            raise RefusedError(f"each point needs {len(names)} positions.")
        order = [list(message.joint_names).index(name) for name in names]
        points = np.array([point.positions for point in message.points]).reshape(-1, len(names))[:, order]
        self._parts.take_arm(_times(message), points, self._now())

    def _take_gripper(self, message: Any) -> None:
        self._parts.take_gripper(message.data, self._now())

    def _now(self) -> Now:
        """Return where the robot is by what it shows."""
        obs = self._robot.reading().obs
        base = np.zeros(0)
        if self._parts.has_base:
            x, y = mat_from_rot6d(obs["base_rot6d"])[:2, 0]
            base = np.append(obs["base_pos"], np.arctan2(y, x))
        return Now(self._robot.time_s, base, obs.get("joint_pos", np.zeros(0)))

    def _obey(self, order: Order, _: Any, response: Any) -> Any:
        numbers = {}
        if order in NUMBERS:
            name, parameter = NUMBERS[order]
            numbers[name] = self._node.get_parameter(parameter).value
        try:
            with self._lock:
                self._robot.order(order, **numbers)
                self._parts.forget()
                if order is Order.RESET:
                    self._parts.opening = 1.0
        except AerialError as error:
            response.success, response.message = False, str(error)
            return response
        response.success, response.message = True, f"{order}: {self._robot.mode}"
        return response

    def _show(self, reading: Reading) -> None:
        obs, spec, time_s = reading.obs, self._robot.spec, reading.stamp_s
        if self._clock is not None:
            self._clock.publish(ros().Clock(clock=exact.stamp(self._robot.time_s)))
        if self._parts.has_base:
            self._publish("odometry", messages.odometry(time_s, obs))
        if self._parts.joints or self._parts.has_gripper:
            self._publish("joint_states", messages.joint_states(time_s, obs))
        self._publish("tool_pose", messages.pose(time_s, obs["ee_pos"], obs["ee_rot6d"]))
        for field in spec.observation.fields:
            if field.group == "image":
                self._show_image(time_s, field, obs[field.name])
            elif field.name not in messages.IN_STANDARD:
                self._publish(f"field/{field.name}", messages.shown(time_s, field, obs, spec))
        told = {name: np.asarray(value).tolist() for name, value in reading.told.items() if name not in LARGE}
        flags = {**told, "armed": reading.armed}
        for name in FLAGS:
            self._say(name, ros().Bool, bool(flags.get(name, False)))
        self._say("mode", ros().String, reading.mode.value)
        self._publish("status", ros().String(data=json.dumps(self._status(reading, told))))
        self._publish("observation", exact.observation(time_s, spec, obs))

    def _status(self, reading: Reading, told: dict[str, Any]) -> dict[str, Any]:
        return {
            "stamp_s": reading.stamp_s,
            "mode": reading.mode.value,
            "armed": reading.armed,
            "told": told,
            "refused": self._refused,
        }

    def _show_image(self, time_s: float, field: Field, values: np.ndarray) -> None:
        fovy = float(self._robot.env.model.camera(exact.camera_of(field)).fovy[0])
        self._publish(f"camera/{field.name}/camera_info", messages.camera_info(time_s, field, fovy))
        self._publish(f"camera/{field.name}/image", exact.image(time_s, field, values))

    def _publish(self, topic: str, message: Any) -> None:
        if topic not in self._publishers:
            self._publishers[topic] = self._node.create_publisher(type(message), topic, 1)
        self._publishers[topic].publish(message)

    def _say(self, topic: str, kind: Any, value: Any) -> None:
        """Publish what seldom changes, when it changes; whoever comes late gets it, too."""
        if topic not in self._publishers:
            self._publishers[topic] = self._node.create_publisher(kind, topic, lasting())
        if self._said.get(topic) != value:
            self._said[topic] = value
            self._publishers[topic].publish(kind(data=value))


def description(robot: SimulatedRobot, speed: float) -> dict[str, Any]:
    """Return what a robot says of itself: its specification, the actions of every level that it takes, its speed."""
    actions = {level: robot.spec_at(level).to_dict()["action"] for level in robot.levels}
    return {"spec": robot.spec.to_dict(), "actions": actions, "speed": speed}


def _require_world(header: Any) -> None:
    if header.frame_id not in ("", messages.WORLD):
        raise RefusedError(f"its frame is {header.frame_id!r}; set points are given in {messages.WORLD!r}.")


def _pos_yaw(pose: Any) -> np.ndarray:
    """Return position and yaw (4,) of a pose or transform; roll and pitch are the flight law's."""
    pos, rot6d = messages.pose_of(pose)
    return np.append(pos, np.arctan2(rot6d[1], rot6d[0]))


def _times(trajectory: Any) -> np.ndarray:
    """Return when the points of a trajectory are due (k,), s from its arrival."""
    return np.array([p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in trajectory.points])
