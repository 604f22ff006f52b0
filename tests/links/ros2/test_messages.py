"""Fields as messages and back: no node and no middleware is needed."""

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install 'aerial_il[ros2]'")

from rclpy.serialization import deserialize_message, serialize_message

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.rotations import mat_from_quat, mat_from_yaw, rot6d_from_mat
from aerial_il.core.specs import Field
from aerial_il.links.ros2 import exact, messages
from aerial_il.links.ros2.middleware import ros
from aerial_il.suite.scenario import Scenario

CELLS = [("ua_quad_arm4", "pick_place"), ("quad", "hover"), ("z1", "reach"), ("fa_hexa_arm4", "inspect_contact")]


def over_the_wire(message):
    return deserialize_message(serialize_message(message), type(message))


def drawn(spec):
    rng = np.random.default_rng(3)
    return {field.name: rng.normal(size=field.shape) / 3.0 for field in spec.observation.fields}


@pytest.mark.parametrize("cell", CELLS, ids=":".join)
def test_observation_arrives_bit_for_bit(cell):
    spec = Scenario(*cell).spec
    obs = drawn(spec)
    arrived = exact.fields_of(over_the_wire(exact.observation(1.0, spec, obs)), spec)
    assert arrived.keys() == obs.keys()
    for name, values in obs.items():
        assert arrived[name].tobytes() == values.tobytes()


def test_observation_of_other_fields_is_refused():
    spec, other = Scenario("ua_quad_arm4", "pick_place").spec, Scenario("ua_quad_arm4", "reach").spec
    with pytest.raises(InvalidValueError, match=r"other fields .*bowl_pos\.x"):
        exact.fields_of(exact.observation(0.0, other, drawn(other)), spec)


@pytest.mark.parametrize(("dtype", "shape"), [("uint8", (4, 6, 3)), ("float32", (4, 6)), ("int32", (4, 6))])
def test_images_arrive_bit_for_bit(dtype, shape):
    field = Field("wrist_x", shape, "image", dtype, frame="camera wrist")
    values = (np.random.default_rng(1).random(shape) * 200 - (dtype != "uint8")).astype(dtype)
    message = over_the_wire(exact.image(0.5, field, values))
    assert exact.image_of(message, field).tobytes() == values.tobytes()
    assert message.header.frame_id == "wrist_optical"
    assert message.step == message.width * np.dtype(dtype).itemsize * (3 if dtype == "uint8" else 1)
    with pytest.raises(InvalidValueError, match="wrist_x arrives as"):
        exact.image_of(message, Field("wrist_x", (8, 6), "image", dtype))


def test_camera_sees_its_angle_of_view():
    info = messages.camera_info(0.0, Field("wrist_rgb", (240, 320, 3), "image", "uint8"), 90.0)
    assert info.k.tolist() == pytest.approx([120.0, 0, 160.0, 0, 120.0, 120.0, 0, 0, 1])


def test_poses_come_back():
    rng = np.random.default_rng(2)
    for _ in range(50):
        quat = rng.normal(size=4)
        pos, rot6d = rng.normal(size=3), rot6d_from_mat(np.array(mat_from_quat(tuple(quat / np.linalg.norm(quat)))))
        back_pos, back_rot6d = messages.pose_of(over_the_wire(messages.pose(0.0, pos, rot6d)).pose)
        assert back_pos.tobytes() == pos.tobytes()
        np.testing.assert_allclose(back_rot6d, rot6d, atol=1e-14)


def test_twist_of_odometry_is_in_the_frame_of_the_base():
    obs = {
        "base_pos": np.array([1.0, 2.0, 3.0]),
        "base_rot6d": rot6d_from_mat(np.array(mat_from_yaw(np.pi / 2))),
        "base_vel": np.array([0.5, 0.0, 0.25]),  # east in the world: to the right of who looks north
        "base_angvel": np.array([0.1, 0.2, 0.3]),
    }
    message = messages.odometry(2.5, obs)
    assert (message.header.frame_id, message.child_frame_id) == ("world", "base_link")
    np.testing.assert_allclose(messages.vector_of(message.twist.twist.linear), [0.0, -0.5, 0.25], atol=1e-12)
    assert messages.vector_of(message.twist.twist.angular).tolist() == [0.1, 0.2, 0.3]
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (2, 500_000_000)


@pytest.mark.parametrize(
    ("change", "says"), [({"w": 0.5}, "norm is 0.5"), ({"w": 1.5}, "norm is 1.5"), ({"x": np.nan}, "not finite")]
)
def test_poses_that_are_none_are_refused(change, says):
    message = ros().PoseStamped().pose
    message.orientation.w = 1.0
    for name, value in change.items():
        setattr(message.orientation, name, value)
    with pytest.raises(InvalidValueError, match=says):
        messages.pose_of(message)


def test_joints_and_gripper_are_named():
    obs = {"joint_pos": np.array([0.1, 0.2]), "joint_vel": np.array([1.0, 2.0]), "gripper": np.array([0.7])}
    message = over_the_wire(messages.joint_states(0.0, obs))
    assert message.name == ["joint_0", "joint_1", "gripper"]
    assert list(message.position) == [0.1, 0.2, 0.7]
    assert list(message.velocity)[:2] == [1.0, 2.0]
    assert np.isnan(message.velocity[2])


@pytest.mark.parametrize(
    ("cell", "name", "kind", "read"),
    [
        (CELLS[0], "cube_pos", "PointStamped", lambda m: messages.vector_of(m.point)),
        (CELLS[0], "tool_to_cube", "Vector3Stamped", lambda m: messages.vector_of(m.vector)),
        (CELLS[0], "cube_heading", "Float64MultiArray", lambda m: np.array(m.data)),
        (CELLS[2], "target_pos", "PoseStamped", lambda m: messages.vector_of(m.pose.position)),
        (CELLS[3], "tool_force", "WrenchStamped", lambda m: messages.vector_of(m.wrench.force)),
        (CELLS[3], "plate_rot6d", "Float64MultiArray", lambda m: np.array(m.data)),
    ],
)
def test_fields_are_shown_as_what_they_are(cell, name, kind, read):
    spec = Scenario(*cell).spec
    obs = drawn(spec)
    message = over_the_wire(messages.shown(0.0, spec.observation[name], obs, spec))
    assert type(message).__name__ == kind
    assert read(message).tolist() == obs[name].tolist()


def test_numbers_without_a_message_have_labels():
    spec = Scenario(*CELLS[0]).spec
    message = messages.labelled(spec.observation["cube_heading"], np.array([0.6, 0.8]))
    assert [(dim.label, dim.size) for dim in message.layout.dim] == [("cos4,sin4", 2)]
