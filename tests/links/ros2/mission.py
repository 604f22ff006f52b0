"""A mission as a user of ROS 2 writes it, with rclpy alone: take off, trajectory, arm, pick and place, land.

The robot is `ua_quad_arm4` in `pick_place`, on a namespace. python -m tests.links.ros2.mission --missions 20
"""

import argparse
import math
import sys
from functools import partial

import rclpy
from geometry_msgs.msg import PointStamped, PoseStamped, Transform
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Float64, Float64MultiArray, String
from std_srvs.srv import Trigger
from trajectory_msgs.msg import (
    JointTrajectory,
    JointTrajectoryPoint,
    MultiDOFJointTrajectory,
    MultiDOFJointTrajectoryPoint,
)

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
ANSWER_S, PICK_S, WAIT_S = 30.0, 60.0, 30.0  # the first by the wall, the others by the robot's clock
HIGH_M, ALIGNED_M, ASTRAY_M, LOST_M, AT_CUBE_M = 0.15, 0.02, 0.05, 0.035, 0.012
AHEAD_M = 0.15  # a set point is at most this far from the tool
GRIP_S, WATCH_S = 0.5, 2.0


class MissionError(Exception):
    """A mission that did not go as it should."""


class Pilot(Node):
    """The robot as its topics and services show it."""

    def __init__(self, namespace: str) -> None:
        super().__init__("mission", namespace=namespace)
        self.seen: dict[str, object] = {}
        topics = {"tool_pose": PoseStamped, "odometry": Odometry, "joint_states": JointState}
        topics |= {"field/cube_pos": PointStamped, "field/bowl_pos": PointStamped}
        topics |= {"field/cube_heading": Float64MultiArray}
        for topic, kind in topics.items():
            self.create_subscription(kind, topic, partial(self._see, topic), 1)
        for topic, kind in {"mode": String, "success": Bool, "crash": Bool}.items():
            self.create_subscription(kind, topic, partial(self._see, topic), LATCHED)
        self.awaited = {*topics, "mode", "success", "crash"}
        self.tool = self.create_publisher(PoseStamped, "set/tool_pose", 1)
        self.grip = self.create_publisher(Float64, "set/gripper", 1)
        self.base_way = self.create_publisher(MultiDOFJointTrajectory, "set/base_trajectory", 1)
        self.arm_way = self.create_publisher(JointTrajectory, "set/arm", 1)
        self.orders = {
            name: self.create_client(Trigger, name) for name in ("reset", "arm", "take_off", "land", "disarm")
        }
        self.parameters = AsyncParameterClient(self, f"{namespace}/robot")

    def _see(self, topic: str, message: object) -> None:
        self.seen[topic] = message

    def open(self) -> None:
        """Wait until all is there."""
        for client in self.orders.values():
            if not client.wait_for_service(ANSWER_S):
                raise MissionError(f"no robot on {self.get_namespace()}")
        self.parameters.wait_for_services(ANSWER_S)
        while self.seen.keys() != self.awaited or not self.tool.get_subscription_count():
            rclpy.spin_once(self, timeout_sec=0.1)

    def order(self, name: str) -> None:
        """Call a service, and refuse a refusal."""
        future = self.orders[name].call_async(Trigger.Request())
        rclpy.spin_until_future_complete(self, future, timeout_sec=ANSWER_S)
        if not future.done() or not future.result().success:
            raise MissionError(f"{name}: {future.result().message if future.done() else 'no answer'}")
        self.wait_for_news()
        self.wait_for_news()

    def set_number(self, name: str, value: float) -> None:
        """Set a parameter of the robot."""
        future = self.parameters.set_parameters([Parameter(name, value=value)])
        rclpy.spin_until_future_complete(self, future, timeout_sec=ANSWER_S)

    def wait_for_news(self) -> None:
        """Wait for the next pose of the tool."""
        last = self.seen["tool_pose"]
        while self.seen["tool_pose"] is last:
            rclpy.spin_once(self, timeout_sec=0.1)

    def wait_until(self, seen, what: str) -> None:
        """Wait for ``seen`` by the robot's clock."""
        end = self.time_s + WAIT_S
        while not seen():
            if self.time_s > end or self.seen["crash"].data:
                raise MissionError(f"{what}: not in {WAIT_S:g} s, mode {self.mode}")
            self.wait_for_news()

    @property
    def mode(self) -> str:
        return self.seen["mode"].data

    @property
    def time_s(self) -> float:
        stamp = self.seen["tool_pose"].header.stamp
        return stamp.sec + 1e-9 * stamp.nanosec

    @property
    def tool_at(self) -> list[float]:
        return xyz(self.seen["tool_pose"].pose.position)

    @property
    def base_at(self) -> list[float]:
        return xyz(self.seen["odometry"].pose.pose.position)

    def point(self, name: str) -> list[float]:
        return xyz(self.seen[f"field/{name}"].point)


def xyz(vector) -> list[float]:
    return [vector.x, vector.y, vector.z]


def aside(a: list[float], b: list[float]) -> float:
    return math.dist(a[:2], b[:2])


def fly_trajectory(pilot: Pilot) -> None:
    """Fly a triangle in four seconds, back to where it began."""
    x, y, z = pilot.base_at
    turn = pilot.seen["odometry"].pose.pose.orientation
    message = MultiDOFJointTrajectory(joint_names=["base"])
    for seconds, dx, dz in ((1, 0.15, 0.1), (2, 0.0, 0.2), (4, 0.0, 0.0)):
        transform = Transform()
        transform.translation.x, transform.translation.y, transform.translation.z = x + dx, y, z + dz
        norm = math.hypot(turn.z, turn.w)
        transform.rotation.z, transform.rotation.w = turn.z / norm, turn.w / norm
        point = MultiDOFJointTrajectoryPoint(transforms=[transform])
        point.time_from_start.sec = seconds
        message.points.append(point)
    begun, highest = pilot.time_s, z
    pilot.base_way.publish(message)
    while pilot.time_s < begun + 4.5:
        pilot.wait_for_news()
        highest = max(highest, pilot.base_at[2])
    if highest < z + 0.1 or math.dist(pilot.base_at, [x, y, z]) > 0.1:
        raise MissionError(
            f"trajectory: rose {highest - z:.2f} m, ended {math.dist(pilot.base_at, [x, y, z]):.2f} m off"
        )


def move_arm(pilot: Pilot) -> None:
    """Move the last joint but one by 0.3 rad and back."""
    state = pilot.seen["joint_states"]
    names = [name for name in state.name if name != "gripper"]
    start = list(state.position[: len(names)])
    there = start.copy()
    there[-2] += -0.3 if start[-2] > 0.0 else 0.3
    message = JointTrajectory(joint_names=names)
    for seconds, positions in ((1, there), (2, start)):
        point = JointTrajectoryPoint(positions=positions)
        point.time_from_start.sec = seconds
        message.points.append(point)
    begun, farthest = pilot.time_s, 0.0
    pilot.arm_way.publish(message)
    while pilot.time_s < begun + 2.5:
        pilot.wait_for_news()
        farthest = max(farthest, abs(pilot.seen["joint_states"].position[len(names) - 2] - start[-2]))
    if farthest < 0.2:
        raise MissionError(f"arm: moved {farthest:.2f} rad of 0.3")


class Pick:
    """Pick the cube, put it into the bowl: one set point after each pose of the tool."""

    def __init__(self, pilot: Pilot) -> None:
        self.pilot, self.phase, self.since = pilot, self.hover, pilot.time_s
        self.rest_z = pilot.point("cube_pos")[2]  # lying on the table

    def run(self) -> None:
        """Go on until the referee is content."""
        end = self.pilot.time_s + PICK_S
        while not self.pilot.seen["success"].data:
            if self.pilot.time_s > end or self.pilot.seen["crash"].data:
                raise MissionError(f"pick: not in {PICK_S:g} s, last at {self.phase.__name__}")
            self.look()
            before = self.phase
            self.phase()
            if self.phase != before:
                self.since = self.pilot.time_s
            self.pilot.wait_for_news()

    def look(self) -> None:
        pilot = self.pilot
        self.cube, self.bowl, self.at = pilot.point("cube_pos"), pilot.point("bowl_pos"), pilot.tool_at
        cos4, sin4 = pilot.seen["field/cube_heading"].data
        self.yaw, self.lasted = 0.25 * math.atan2(sin4, cos4), pilot.time_s - self.since
        self.lost = math.dist(self.cube, self.at) > LOST_M

    def go(self, target: list[float], yaw: float, opening: float) -> None:
        """Send the tool towards a target, pointing down."""
        distance = math.dist(target, self.at)
        share = min(1.0, AHEAD_M / max(distance, 1e-9))
        message = PoseStamped()
        message.header.frame_id = "world"
        place, turn, half = message.pose.position, message.pose.orientation, math.sqrt(0.5)
        place.x, place.y, place.z = (a + share * (b - a) for a, b in zip(self.at, target, strict=True))
        cos, sin = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
        turn.w, turn.x, turn.y, turn.z = cos * half, -sin * half, cos * half, sin * half
        self.pilot.grip.publish(Float64(data=opening))
        self.pilot.tool.publish(message)

    def hover(self) -> None:
        self.go([*self.cube[:2], self.cube[2] + HIGH_M], self.yaw, 1.0)
        if aside(self.cube, self.at) < ALIGNED_M and self.at[2] < self.cube[2] + HIGH_M + 0.05 and self.lasted > 0.4:
            self.phase = self.descend

    def descend(self) -> None:
        self.go([*self.cube[:2], max(self.cube[2], self.at[2] - 0.08)], self.yaw, 1.0)
        if aside(self.cube, self.at) > ASTRAY_M or self.lasted > 3.0:
            self.phase = self.hover
        elif aside(self.cube, self.at) < ALIGNED_M and self.at[2] < self.cube[2] + AT_CUBE_M:
            self.phase = self.close

    def close(self) -> None:
        self.go(self.cube, self.yaw, 0.0)
        if self.lasted > GRIP_S:
            self.phase = self.lift

    def lift(self) -> None:
        raised = max(self.cube[2] - self.rest_z, 0.0)
        top = self.rest_z + HIGH_M
        self.go([*self.at[:2], min(top, self.at[2] + 0.015 + raised)], 0.0, 0.0)
        if self.lost:
            self.phase = self.hover
        elif self.at[2] > top - 0.03:
            self.phase = self.carry

    def carry(self) -> None:
        self.go([*self.over_bowl(), self.rest_z + HIGH_M], 0.0, 0.0)
        velocity = self.pilot.seen["odometry"].twist.twist.linear
        if self.lost:
            self.phase = self.hover
        elif aside(self.cube, self.bowl) < ALIGNED_M and math.hypot(velocity.x, velocity.y) < 0.2:
            self.phase = self.lower

    def lower(self) -> None:
        drop = self.bowl[2] + 0.035 + self.at[2] - self.cube[2]
        self.go([*self.over_bowl(), max(drop, self.at[2] - 0.08)], 0.0, 0.0)
        if aside(self.cube, self.bowl) > ASTRAY_M:
            self.phase = self.carry
        elif self.cube[2] - self.bowl[2] < 0.055 and aside(self.cube, self.bowl) < ALIGNED_M:
            self.phase = self.release

    def release(self) -> None:
        self.go([*self.at[:2], self.bowl[2] + 0.035], 0.0, 1.0)
        if self.lasted > GRIP_S:
            self.phase = self.retreat

    def retreat(self) -> None:
        self.go([*self.bowl[:2], self.bowl[2] + 0.25], 0.0, 1.0)
        if self.lasted > WATCH_S:
            self.phase = self.hover

    def over_bowl(self) -> list[float]:
        """Where the tool is when the cube is over the bowl."""
        return [self.bowl[i] + self.at[i] - self.cube[i] for i in range(2)]


def fly(pilot: Pilot, seed: int) -> float:
    """Fly one mission, and return how long it took, s by the robot's clock.

    Raises:
        MissionError: it went wrong; says where.
    """
    pilot.set_number("seed", seed)
    pilot.set_number("take_off_height", 0.3)
    pilot.order("reset")
    begun = pilot.time_s
    pilot.order("arm")
    pilot.order("take_off")
    pilot.wait_until(lambda: pilot.mode == "holding", "take_off")
    fly_trajectory(pilot)
    move_arm(pilot)
    Pick(pilot).run()
    pilot.order("land")
    pilot.wait_until(lambda: pilot.mode == "standing", "land")
    if not pilot.seen["success"].data:
        raise MissionError("the referee has changed its mind")
    return pilot.time_s - begun


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--namespace", default="/aerial")
    parser.add_argument("--missions", type=int, default=1)
    parser.add_argument("--seed", type=int, default=10000, help="of the first mission")
    given = parser.parse_args()
    rclpy.init()
    pilot, successes = Pilot(given.namespace), 0
    try:
        pilot.open()
        for seed in range(given.seed, given.seed + given.missions):
            try:
                took = fly(pilot, seed)
                successes += 1
                print(f"seed {seed}: in the bowl and landed after {took:.1f} s", flush=True)
            except MissionError as error:
                print(f"seed {seed}: {error}", flush=True)
    finally:
        pilot.destroy_node()
        rclpy.shutdown()
    print(f"{successes} of {given.missions} missions succeeded")
    return 0 if successes == given.missions else 1


if __name__ == "__main__":
    sys.exit(main())
