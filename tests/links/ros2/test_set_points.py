"""Set points that are put together from messages about parts; needs no ROS."""

import numpy as np
import pytest

from aerial_il.control.actions import ActionLevel, action_spec
from aerial_il.core import registry
from aerial_il.links.link import RefusedError
from aerial_il.links.ros2.set_points import Now, SetPoints

HERE, JOINTS = np.array([0.1, 0.2, 1.2, 0.3]), np.array([0.1, -0.2, 0.3, 0.0])
POSE = np.array([0.3, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0])
AT_ONCE = np.zeros(1)


def set_points(robot: str = "ua_quad_arm4") -> SetPoints:
    vehicle = registry.get("robot", robot).vehicle
    levels = (ActionLevel.EE_POSE, ActionLevel.BASE_JOINT, ActionLevel.VELOCITY)
    return SetPoints({level.label: action_spec(level, vehicle) for level in levels})


def now(time_s: float = 0.0) -> Now:
    return Now(time_s, HERE, JOINTS)


def test_nothing_is_composed_of_nothing():
    assert set_points().compose(0.0) is None


def test_tool_and_gripper_make_a_pose_of_the_tool():
    parts = set_points()
    parts.take_tool(POSE, now())
    parts.take_gripper(0.25, now())
    level, action = parts.compose(0.0)
    assert level == "ee_pose"
    assert action.tolist() == [*POSE, 0.25]
    assert parts.compose(0.02) is None  # nothing new


def test_base_and_arm_are_put_together():
    parts = set_points()
    parts.take_base(AT_ONCE, np.array([[1.0, 0.5, 1.5, -0.4]]), now())
    level, action = parts.compose(0.0)
    assert level == "base_joint"
    assert action == pytest.approx([1.0, 0.5, 1.5, -0.4, *JOINTS, 1.0])
    parts.take_arm(AT_ONCE, np.array([[0.2, 0.1, 0.3, 0.1]]), now(0.02))
    assert parts.compose(0.02)[1] == pytest.approx([1.0, 0.5, 1.5, -0.4, 0.2, 0.1, 0.3, 0.1, 1.0])


def test_arm_takes_over_from_the_tool():
    parts = set_points()
    parts.take_tool(POSE, now())
    parts.take_arm(AT_ONCE, JOINTS[None] + 0.1, now())
    level, action = parts.compose(0.0)
    assert level == "base_joint"
    assert action == pytest.approx([*HERE, *(JOINTS + 0.1), 1.0])


def test_trajectory_of_the_arm_goes_on_by_itself():
    parts = set_points()
    parts.take_arm(np.array([1.0, 2.0]), np.array([JOINTS + 0.4, JOINTS]), now(5.0))
    for time_s, more in ((5.0, 0.0), (5.5, 0.2), (6.0, 0.4), (6.75, 0.1)):
        assert parts.compose(time_s)[1][4:8] == pytest.approx(JOINTS + more)
    assert parts.compose(7.02) is None


def test_trajectory_of_the_base_turns_the_short_way():
    parts, there = set_points(), np.array([0.1, 0.2, 1.2, -3.0])
    parts.take_base(np.array([1.0]), there[None], Now(0.0, np.array([0.1, 0.2, 1.2, 3.0]), JOINTS))
    yaws = [parts.compose(time_s)[1][3] for time_s in (0.0, 0.25, 0.75, 1.0)]
    assert np.abs(yaws) == pytest.approx([3.0, 3.0 + 0.0708, 3.0 + 0.0708, 3.0], abs=1e-4)
    assert np.sign(yaws).tolist() == [1, 1, -1, -1]


def test_velocity_moves_the_arm_as_fast_as_its_trajectory():
    parts = set_points()
    parts.take_velocity(np.array([0.1, 0.0, -0.1, 0.2]), now())
    parts.take_arm(np.array([2.0]), JOINTS[None] + 0.4, now())
    level, action = parts.compose(1.0)
    assert level == "velocity"
    assert action == pytest.approx([0.1, 0.0, -0.1, 0.2, *[0.2] * 4, 1.0])
    assert parts.compose(1.02) is None  # a velocity does not go on by itself


def test_after_a_silence_what_was_sent_is_forgotten():
    parts = set_points()
    parts.take_base(AT_ONCE, np.array([[1.0, 0.5, 1.5, -0.4]]), now())
    parts.take_gripper(0.0, now())
    parts.compose(0.0)
    parts.take_arm(AT_ONCE, JOINTS[None] + 0.1, now(1.0))
    assert parts.compose(1.0)[1] == pytest.approx([*HERE, *(JOINTS + 0.1), 0.0])


def test_robot_without_gripper_and_arm():
    parts = set_points("quad")
    parts.take_base(AT_ONCE, HERE[None], Now(0.0, HERE, np.zeros(0)))
    assert parts.compose(0.0)[1] == pytest.approx(HERE)
    with pytest.raises(RefusedError, match="no gripper"):
        parts.take_gripper(1.0, now())
    with pytest.raises(RefusedError, match="0 joints"):
        parts.take_arm(AT_ONCE, np.zeros((1, 1)), now())


def test_fixed_base_takes_no_pose():
    parts = set_points("z1")
    joints = np.zeros(parts.joints)
    with pytest.raises(RefusedError, match="base is fixed"):
        parts.take_base(AT_ONCE, HERE[None], now())
    parts.take_arm(AT_ONCE, joints[None], Now(0.0, np.zeros(0), joints))
    assert parts.compose(0.0)[1].size == parts.joints + parts.has_gripper


@pytest.mark.parametrize(
    ("times", "points", "says"),
    [
        ([0.0], [[np.nan, 0, 0, 0]], "not finite"),
        ([0.0], [[0, 0, 0]], "4 joints"),
        ([1.0, 1.0], [[0, 0, 0, 0]] * 2, "times rise"),
        ([], np.zeros((0, 4)), "times rise"),
        ([-1.0], [[0, 0, 0, 0]], "times rise"),
    ],
)
def test_bad_trajectories_are_refused_and_change_nothing(times, points, says):
    parts = set_points()
    parts.take_tool(POSE, now())
    with pytest.raises(RefusedError, match=says):
        parts.take_arm(np.array(times), np.array(points, float), now())
    assert parts.compose(0.0)[0] == "ee_pose"
