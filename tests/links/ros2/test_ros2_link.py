"""A robot in one process, and whoever flies it in another."""

import os
import signal
import subprocess
import sys
import time
from functools import partial

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install 'aerial_il[ros2]'")

from trajectory_msgs.msg import JointTrajectoryPoint

from aerial_il.core import registry
from aerial_il.core.errors import AerialError, InvalidValueError, UnknownNameError
from aerial_il.links.link import LinkError, Mode, Order, RefusedError
from aerial_il.links.robot import SimulatedRobot
from aerial_il.links.ros2.middleware import Served, lasting, ros
from aerial_il.links.ros2.robot_node import RobotNode
from aerial_il.links.ros2.ros2_link import Ros2Link
from tests.patience import wait_until

ROBOT, TASK = "ua_quad_arm4", "pick_place"
HOVERS_WITHIN_S = 0.3  # of silence, by the robot's clock


@pytest.fixture
def link(serve):
    serve(ROBOT, TASK, "/one", 4)
    link = registry.get("link", "ros2")(namespace="/one").connect(lambda: None)
    yield link
    link.close()


@pytest.fixture
def others():
    """A node that is somebody's own."""
    served = Served("own", "/one")
    served.start()
    yield served.node
    served.close()


def in_the_air(link):
    link.order(Order.ARM)
    link.order(Order.TAKE_OFF, height_m=0.2)
    while link.read().mode is Mode.TAKING_OFF or np.linalg.norm(link.read().obs["base_vel"]) > 0.02:
        link.step()
    assert link.read().mode is Mode.HOLDING


def test_readings_are_the_robots_own_bit_for_bit(link):
    robot = SimulatedRobot(ROBOT, TASK)
    assert link.spec == robot.spec
    assert link.levels == robot.levels
    assert link.speed == 4.0
    for seed in (3, 4):
        link.order(Order.RESET, seed=seed)
        robot.reset(seed)
        shown, own = link.read(), robot.reading()
        assert shown.told["seed"] == seed
        assert (shown.mode, shown.armed) == (Mode.STANDING, False)
        assert shown.obs.keys() == own.obs.keys()
        for name, values in own.obs.items():
            assert shown.obs[name].tobytes() == values.tobytes()
    robot.close()


@pytest.mark.render
def test_images_belong_to_their_reading(serve):
    serve(ROBOT, TASK, "/one", 1, "wrist", "wrist:depth")
    robot, link = SimulatedRobot(ROBOT, TASK, cameras=("wrist", "wrist:depth"), image_size=(24, 32)), Ros2Link("/one")
    assert link.spec == robot.spec
    for seed in (0, 3):  # a reset draws on another thread than a tick
        link.order(Order.RESET, seed=seed)
        robot.reset(seed)
        shown, own = link.read(), robot.reading()
        for name in ("wrist_rgb", "wrist_depth"):
            assert shown.obs[name].dtype == own.obs[name].dtype
            assert shown.obs[name].tobytes() == own.obs[name].tobytes()
    link.order(Order.ARM)
    link.order(Order.TAKE_OFF)
    assert link.read().mode is Mode.TAKING_OFF
    link.close()
    robot.close()


def test_flies_at_every_level_and_lands(link):
    in_the_air(link)
    start = link.read().obs
    moves = {"ee_pose": [*start["ee_pos"] + [0.1, 0.0, 0.0], *start["ee_rot6d"], 1.0]}
    moves["base_joint"] = [*start["base_pos"] + [0.0, 0.1, 0.0], 0.0, *start["joint_pos"], 1.0]
    moves["velocity"] = [0.0, 0.0, 0.1, *np.zeros(5), 1.0]
    for level, action in moves.items():
        before, began = link.read().obs["base_pos"], link.read().stamp_s
        while link.read().stamp_s < began + 1.5:
            link.send(level, np.array(action))
            link.step()
        assert link.read().mode is Mode.FLYING
        axis = {"ee_pose": 0, "base_joint": 1, "velocity": 2}[level]
        assert (link.read().obs["base_pos"] - before)[axis] > 0.05
    link.order(Order.LAND)
    while link.read().mode is Mode.LANDING:
        link.step()
    assert (link.read().mode, link.read().armed) == (Mode.STANDING, False)


def test_orders_are_refused_with_the_robots_words(link):
    with pytest.raises(RefusedError, match="not armed"):
        link.order(Order.TAKE_OFF)
    link.order(Order.ARM)
    with pytest.raises(RefusedError, match="height_m is 50"):
        link.order(Order.TAKE_OFF, height_m=50.0)
    in_the_air(link)
    with pytest.raises(RefusedError, match="land first"):
        link.order(Order.DISARM)
    assert link.read().mode is Mode.HOLDING


def test_bad_set_points_are_refused_before_they_are_sent(link):
    with pytest.raises(RefusedError, match="ee_y of the set point is not finite"):
        link.send("ee_pose", np.array([0.0, np.nan, *np.zeros(8)]))
    with pytest.raises(RefusedError, match="takes 10 numbers"):
        link.send("ee_pose", np.zeros(9))
    with pytest.raises(RefusedError, match=r"'rotor'. Valid: ee_pose, base_joint, velocity"):
        link.send("rotor", np.zeros(9))


def test_bad_messages_of_others_are_refused_and_counted(link, others):
    in_the_air(link)
    labels = list(link.spec.action.labels)
    bad = {
        "action": ros().JointState(name=labels, position=[np.nan] * len(labels)),
        "arm": ros().JointTrajectory(joint_names=["shoulder", "elbow"]),
        "tool_pose": ros().PoseStamped(),
    }
    bad["tool_pose"].pose.orientation.w = 0.5
    for topic, message in bad.items():
        publisher = others.create_publisher(type(message), f"set/{topic}", 1)
        wait_until(publisher.get_subscription_count)
        while topic not in link.read().told["refused"]:  # its side may hear of the publisher later than this one
            publisher.publish(message)
            link.step()
            link.step()
    assert link.read().mode is Mode.HOLDING


def test_parts_of_set_points_arrive_from_others(link, others):
    in_the_air(link)
    start = link.read()
    way = ros().JointTrajectory(joint_names=[f"joint_{i}" for i in (3, 2, 1, 0)])  # in their own order
    there = start.obs["joint_pos"] + [0.2, 0.0, 0.0, 0.0]
    way.points = [_point(there[::-1], 1)]
    publisher = others.create_publisher(ros().JointTrajectory, "set/arm", 1)
    wait_until(publisher.get_subscription_count)
    while link.read().mode is not Mode.FLYING:  # its side may hear of the publisher later than this one
        publisher.publish(way)
        link.step()
    while link.read().mode is Mode.FLYING:
        link.step()
    np.testing.assert_allclose(link.read().obs["joint_pos"], there, atol=0.05)
    np.testing.assert_allclose(link.read().obs["base_pos"], start.obs["base_pos"], atol=0.05)


@pytest.mark.parametrize("topic", ["base_pose", "base_velocity"])
def test_base_is_led_by_others(link, others, topic):
    in_the_air(link)
    start, message = link.read(), ros().PoseStamped() if topic == "base_pose" else ros().TwistStamped()
    message.header.frame_id = "world"
    if topic == "base_pose":
        place = message.pose.position
        place.x, place.y, place.z = start.obs["base_pos"] + [0.0, 0.0, 0.3]
    else:
        message.twist.linear.z = 0.3
    publisher = others.create_publisher(type(message), f"set/{topic}", 1)
    wait_until(publisher.get_subscription_count)
    followed = 0
    while followed < 75:  # its side may hear of the publisher later than this one
        publisher.publish(message)
        link.step()
        followed += link.read().mode is Mode.FLYING
    assert link.read().obs["base_pos"][2] - start.obs["base_pos"][2] > 0.15
    assert link.read().told["refused"] == {}


def test_what_belongs_to_one_moment_has_one_stamp(others):
    robot, heard = SimulatedRobot(ROBOT, TASK), {}
    node = RobotNode(robot, namespace="/one", clock=True)
    kinds = {"odometry": ros().Odometry, "tool_pose": ros().PoseStamped, "joint_states": ros().JointState}
    kinds |= {"field/cube_pos": ros().PointStamped, "/clock": ros().Clock, "mode": ros().String}
    for topic, kind in kinds.items():
        others.create_subscription(kind, topic, partial(heard.__setitem__, topic), lasting() if topic == "mode" else 1)
    for _ in range(3):
        node.tick()  # with nobody to hear it, perhaps
    wait_until(lambda: node.tick() or heard.keys() == kinds.keys())
    wait_until(lambda: len({(at.sec, at.nanosec) for at in _stamps(node, heard)}) == 1)
    assert heard["mode"].data == "standing"
    assert _seconds(heard["/clock"].clock) == pytest.approx(robot.time_s)
    place = heard["field/cube_pos"].point
    assert [place.x, place.y, place.z] == robot.reading().obs["cube_pos"].tolist()
    node.close()
    robot.close()


def test_nobody_on_a_namespace_is_said_and_who_is_elsewhere(link):
    with pytest.raises(LinkError, match=r"no robot described itself on /two.* Namespaces with robots: /one"):
        Ros2Link("/two", timeout_s=2.0)
    with pytest.raises(InvalidValueError, match="no namespace"):
        Ros2Link("/no such name")
    with pytest.raises(UnknownNameError, match="ee_pose"):
        Ros2Link("/one", level="ee_poes")


def test_two_robots_do_not_meet(link, serve):
    serve("quad", "hover", "/two", 4)
    two = Ros2Link("/two")
    assert (link.spec.robot, two.spec.robot) == ("ua_quad_arm4", "quad")
    in_the_air(two)
    two.send("velocity", np.array([0.1, 0.0, 0.0, 0.0]))
    two.step()
    link.step()
    assert two.read().armed
    assert (link.read().mode, link.read().armed) == (Mode.STANDING, False)
    two.close()


def test_two_robots_on_one_namespace_are_not_flown(link, others):
    robot = SimulatedRobot("quad", "hover")
    wait_until(lambda: _says(lambda: RobotNode(robot, namespace="/one").close(), "A robot is on /one already"))
    publisher = others.create_publisher(ros().String, "description", lasting())
    wait_until(lambda: _says(lambda: Ros2Link("/one").close(), "2 robots are on /one"))
    others.destroy_publisher(publisher)
    robot.close()


def test_robot_that_is_gone_does_not_answer(serve):
    process, link = serve("quad", "hover", "/one", 1), Ros2Link("/one", timeout_s=3.0)
    process.kill()
    process.wait()
    with pytest.raises(LinkError, match="the robot on /one did not answer 'arm'"):
        link.order(Order.ARM)
    with pytest.raises(LinkError, match="showed no whole reading"):
        link.step()
    link.close()


def test_hovers_when_whoever_flew_it_was_killed():
    """The robot's clock is moved by the test, so that how long a busy machine takes does not count."""
    robot = SimulatedRobot(ROBOT, TASK)
    node = RobotNode(robot, namespace="/one", clock=False)
    robot.order(Order.ARM)
    robot.order(Order.TAKE_OFF, height_m=0.0)
    stream = subprocess.Popen([sys.executable, "-m", "tests.links.ros2.stream", "/one"], stdout=subprocess.PIPE)
    while stream.poll() is None and np.linalg.norm(robot.reading().obs["base_vel"]) < 0.1:
        node.tick()
        time.sleep(0.001)
    assert robot.mode is Mode.FLYING
    stream.send_signal(signal.SIGKILL)
    stream.wait()
    assert robot.mode is Mode.FLYING
    time.sleep(0.5)  # what it had sent arrives meanwhile
    killed_s = robot.time_s
    while robot.mode is Mode.FLYING:
        node.tick()
        assert robot.time_s - killed_s <= HOVERS_WITHIN_S + 1e-9
    assert robot.mode is Mode.HOLDING
    for _ in range(100):
        node.tick()
    assert np.linalg.norm(robot.reading().obs["base_vel"]) < 0.05
    node.close()
    robot.close()


def test_mission_by_a_process_that_knows_nothing_of_us(serve):
    serve(ROBOT, TASK, "/one", 2)
    command = [sys.executable, "-m", "tests.links.ros2.mission", "--namespace", "/one", "--seed", "7"]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ)
    assert done.stdout.splitlines()[-1:] == ["1 of 1 missions succeeded"], done.stdout + done.stderr


def _stamps(node, heard):
    """Return the stamps of what has arrived of one more tick."""
    node.tick()
    time.sleep(0.1)
    return [message.header.stamp for message in heard.values() if hasattr(message, "header")] + [heard["/clock"].clock]


def _seconds(stamp):
    return stamp.sec + 1e-9 * stamp.nanosec


def _says(attempt, words):
    """Whether an attempt is refused in these words; nodes hear of each other when they do."""
    try:
        attempt()
    except AerialError as error:
        return words in str(error)
    return False


def _point(positions, seconds):
    point = JointTrajectoryPoint(positions=list(positions))
    point.time_from_start.sec = seconds
    return point
