"""Robots are what their parameters say, and strong enough for the tasks they support."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

import aerial_il
from aerial_il import robots
from aerial_il.control.vehicle import GRAVITY
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.robots.figures import servo_loads
from aerial_il.robots.parts.arm import Arm
from aerial_il.robots.parts.camera import look_along
from aerial_il.robots.parts.rotorcraft import ring
from aerial_il.robots.robot import LATERAL_SHARE, Robot
from tests.examples import plugged_in

ROBOTS = [robots.get(name) for name in robots.names()]
each_robot = pytest.mark.parametrize("robot", ROBOTS, ids=robots.names())
each_armed = pytest.mark.parametrize("robot", [r for r in ROBOTS if r.num_joints], ids=lambda r: r.name)


def compiled(robot: Robot) -> mujoco.MjModel:
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    robot.add_to(spec)
    return spec.compile()


@pytest.mark.parametrize(
    ("name", "actuation", "mass", "thrust_to_weight"),
    [
        ("ua_quad_arm4", "under", 2.3, 2.4),
        ("fa_hexa_arm4", "full", 6.42, 2.24),
        ("big_four_z1", "under", 20.7, 1.97),
        ("mini_quad_gripper", "under", 0.69, 2.48),
        ("floating_gripper", "full", 2.0, 3.06),
        ("quad", "under", 1.9, 2.9),
        ("z1", "fixed", 4.69, 0.0),
    ],
)
def test_published_figures(name: str, actuation: str, mass: float, thrust_to_weight: float) -> None:
    robot = robots.get(name)
    assert robot.name == name
    assert robot.actuation == actuation
    assert robot.vehicle.mass == pytest.approx(mass, rel=0.01)
    assert robot.vehicle.thrust_to_weight == pytest.approx(thrust_to_weight, rel=0.02)


def test_the_hexarotor_pushes_sideways_at_level_hover() -> None:
    assert 13.0 < robots.get("fa_hexa_arm4").lateral_force < 18.0
    assert robots.get("ua_quad_arm4").lateral_force == 0.0


@each_robot
def test_actuators_come_in_the_order_rotors_joints_gripper(robot: Robot) -> None:
    model = compiled(robot)
    names = [model.actuator(i).name for i in range(model.nu)]
    rotors, joints = [f"rotor_{i}" for i in range(robot.num_rotors)], [f"joint_{j}" for j in range(robot.num_joints)]
    assert names == [*rotors, *joints, *(["gripper"] if robot.has_gripper else [])]
    first = ["base"] if not robot.fixed else []
    assert [model.joint(i).name for i in range(len(first) + robot.num_joints)] == [*first, *joints]


@each_armed
def test_servos_hold_the_arm_in_any_posture(robot: Robot) -> None:
    model, vehicle = compiled(robot), robot.vehicle
    torque = np.array([link.torque for link in robot.arm.links])
    for j in range(robot.num_joints):
        np.testing.assert_array_equal(model.actuator(f"joint_{j}").forcerange, [-torque[j], torque[j]])
        np.testing.assert_allclose(model.joint(f"joint_{j}").range, [vehicle.joint_low[j], vehicle.joint_high[j]])
    assert (torque <= 3.0 * GRAVITY * vehicle.mass * (robot.arm.reach + 0.1)).all(), "not a thousand newton metres"
    assert (servo_loads(robot) < 0.6).all()


@each_armed
def test_rest_postures_point_where_they_say(robot: Robot) -> None:
    model, vehicle = compiled(robot), robot.vehicle
    data = mujoco.MjData(model)
    for posture, along in ((robot.rest_forward, [1.0, 0.0, 0.0]), (robot.rest_down, [0.0, 0.0, -1.0])):
        assert (vehicle.joint_low < posture).all()
        assert (posture < vehicle.joint_high).all()
        first, _ = robot.first_joint
        data.qpos[first : first + robot.num_joints] = posture
        mujoco.mj_forward(model, data)
        assert data.site("tool").xmat.reshape(3, 3)[:, 0] @ along > np.cos(0.02)
        assert robot.fixed or data.site("tool").xpos[2] < -robot.base.hub_size[2], "the tool hangs below the base"


@each_armed
def test_the_gripper_opens_closes_and_squeezes(robot: Robot) -> None:
    model = compiled(robot)
    model.opt.gravity[:] = 0.0
    data, stroke = mujoco.MjData(model), robot.gripper.stroke
    left, right = (model.joint(f"finger_{side}").qposadr[0] for side in ("left", "right"))
    for target in (stroke, 0.0):
        data.actuator("gripper").ctrl[:] = target
        for _ in range(400):
            mujoco.mj_step(model, data)
        assert data.qpos[left] == pytest.approx(target, abs=0.002)
        assert data.qpos[right] == pytest.approx(data.qpos[left], abs=0.001)
    data.actuator("gripper").ctrl[:] = stroke
    mujoco.mj_forward(model, data)
    assert robot.gripper.force >= 6.0
    assert abs(data.actuator("gripper").force[0]) == pytest.approx(2.0 * robot.gripper.force)


def test_a_rotor_ring_is_level_or_canted_about_its_booms() -> None:
    pos, axis = ring(6, 0.4, first_angle=0.0, height=0.02, cant=0.4)
    np.testing.assert_allclose(np.linalg.norm(pos[:, :2], axis=1), 0.4)
    np.testing.assert_allclose(axis[:, 2], np.cos(0.4))
    np.testing.assert_allclose(np.einsum("ri,ri->r", pos[:, :2], axis[:, :2]), 0.0, atol=1e-12)
    np.testing.assert_allclose(axis.sum(axis=0)[:2], 0.0, atol=1e-12)


@each_robot
def test_the_controller_keeps_a_reserve_of_sideways_force(robot: Robot) -> None:
    assert robot.vehicle.lateral_limit == pytest.approx(LATERAL_SHARE * robot.lateral_force)


def test_a_camera_looks_where_it_should() -> None:
    rot = np.empty(9)
    mujoco.mju_quat2Mat(rot, look_along(np.array([1.0, 1.0, -1.0])))
    axes = rot.reshape(3, 3)
    np.testing.assert_allclose(-axes[:, 2], np.array([1.0, 1.0, -1.0]) / np.sqrt(3.0), atol=1e-12)
    assert axes[2, 0] == pytest.approx(0.0), "the horizon is level"
    assert axes[2, 1] > 0.0, "and the right way up"


def test_an_unknown_robot_is_answered_with_the_nearest() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'fa_hexa_arm4'"):
        robots.get("fa_hexa_arm")


WHOLE = robots.get("fa_hexa_arm4")


def with_link(i: int, **changed: Any) -> Arm:
    links = list(WHOLE.arm.links)
    links[i] = replace(links[i], **changed)
    return replace(WHOLE.arm, links=tuple(links))


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"arm": with_link(1, axis=(0.0, 2.0, 0.0))}, r"axis of joint 1 is \[0.0, 2.0, 0.0\]; it must be of length 1"),
        ({"base": replace(WHOLE.base, rotor_axis=2.0 * WHOLE.base.rotor_axis)}, "rotor_axis 0 is .* of length 1"),
        ({"rest_down": WHOLE.rest_down[:2]}, "rest_down has 2 angles for 4 joints"),
        ({"rest_forward": (0.0, 0.35, -9.0, 0.0)}, r"rest_forward puts joint 2 at -9 rad; its limits are \("),
        ({"base": replace(WHOLE.base, tau_up=0.05, tau_down=0.01)}, "tau_down is 0.01 s and tau_up 0.05 s"),
        ({"base": replace(WHOLE.base, inertia=(62.0, 62.0, 110.0))}, "inertia is 110 kg m².*Is it in g m²"),
        (
            {"base": replace(WHOLE.base, rotor_pos=1e3 * WHOLE.base.rotor_pos)},
            "m from the base, 3.0 m at most. Is it in mm",
        ),
        ({"gripper": replace(WHOLE.gripper, stroke=40.0)}, "opens by 40 m, 0.5 m at most. Is it in mm"),
        ({"arm": with_link(1, limits=(-104.0, 76.0))}, "joint 1 turns from .* rad. Are they in degrees"),
    ],
)
def test_what_the_simulator_would_read_otherwise_is_refused(changed: dict[str, Any], says: str) -> None:
    with pytest.raises(InvalidValueError, match=says):
        replace(WHOLE, **changed)


def test_a_joint_may_sit_on_another() -> None:
    assert np.isfinite(compiled(replace(WHOLE, arm=with_link(2, tip=(0.0, 0.0, 0.0)))).body_inertia).all()


def test_an_arm_of_the_most_joints_flies() -> None:
    with plugged_in({"robot": {"many_joints": "tests.examples.many_joints"}}):
        env = aerial_il.load_batch("many_joints", "reach", num_envs=1)
        env.reset(0)
        result = env.step(env.spec.action.clip(np.zeros((1, env.spec.action.size))))
        assert env.simulation.view.records["num_unwanted"][0] == 9
        assert not result.info["crash"].any()
        env.close()
