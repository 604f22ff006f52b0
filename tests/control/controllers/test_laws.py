"""Each flight law does what its textbook says: step responses within bounds, gains that are known, offsets removed."""

import mujoco
import numpy as np
import pytest

from aerial_il.control import controller_state as layout
from aerial_il.control.controllers import lqr
from aerial_il.control.hover import hover_body
from aerial_il.control.vehicle import GRAVITY, Vehicle
from aerial_il.core import registry
from experiments.controllers.steps import StepFigures, step_figures
from tests.control.in_the_air import Flight
from tests.control.nominal import compile_nominal, each_vehicle

ROBOTS = ("fa_hexa_arm4", "ua_quad_arm4")
SAMPLE_S = 0.02
# Largest rise time (s), overshoot (%) and settling time (s, within 5 %) of a step of 1 m and of one of 30 degrees.
BOUNDS = {
    "geometric_observer": {"position": (1.0, 1.0, 1.8), "yaw": (0.4, 30.0, 1.0)},
    "geometric": {"position": (1.0, 1.0, 1.8), "yaw": (0.4, 30.0, 1.0)},
    "pid": {"position": (1.0, 6.0, 1.8), "yaw": (1.1, 6.0, 1.5)},
    "lqr": {"position": (0.8, 5.0, 1.3), "yaw": (0.9, 5.0, 1.2)},
}
each_robot = pytest.mark.parametrize("robot", ROBOTS)
each_law = pytest.mark.parametrize("law", registry.names("controller"))


def step(robot: str, law: str, kind: str) -> StepFigures:
    """Hover, let the reference jump, measure what the base makes of it."""
    flight = Flight(robot, "base_joint", law=law)
    action = flight.place()
    flight.fly(action, 3.0)
    entry, k, size = (layout.BASE_POS, 0, 1.0) if kind == "position" else (layout.BASE_YAW, 3, np.deg2rad(30.0))
    action[k] += size
    flight.controller.state[entry] = action[k]
    made = []
    for _ in range(200):
        flight.fly(action, SAMPLE_S)
        made.append((flight.base[0] if kind == "position" else flight.yaw) / size)
    return step_figures(np.array(made), SAMPLE_S)


@each_robot
@each_law
@pytest.mark.parametrize("kind", ["position", "yaw"])
def test_a_step_response_keeps_to_its_bounds(robot: str, law: str, kind: str) -> None:
    result, (rise, overshoot, settling) = step(robot, law, kind), BOUNDS[law][kind]
    assert result.rise_s <= rise
    assert result.overshoot_percent <= overshoot
    assert result.settling_s <= settling
    assert result.offset_percent < 2.0


@each_robot
@each_law
def test_the_tool_goes_where_it_is_sent_under_every_law(robot: str, law: str) -> None:
    flight = Flight(robot, law=law)
    action = flight.pose((0.4, -0.3, 0.2))
    flight.fly(action, 6.0)
    assert np.linalg.norm(flight.tool - action[:3]) < 0.02
    assert np.linalg.norm(flight.data.qvel[:3]) < 0.03


@each_robot
def test_pid_removes_a_constant_force_and_pd_alone_does_not(robot: str) -> None:
    left = {}
    for name, gains in (("pid", None), ("pd", registry.get("controller", "pid")().gains._replace(integral=0.0))):
        flight = Flight(robot, "base_joint", law="pid", gains=gains)
        action = flight.place()
        flight.fly(action, 10.0, (0.08 * flight.vehicle.mass * GRAVITY, 0.0, 0.0))
        left[name] = abs(flight.base[0] - action[0])
    expected = 0.08 * GRAVITY / registry.get("controller", "pid")().gains.position
    assert left["pid"] < 0.005
    assert left["pd"] == pytest.approx(expected, rel=0.25), "force per mass over stiffness"


def test_the_integrators_of_pid_do_not_wind_up() -> None:
    """Held back by more than it may push, then let go: it comes back without flying far beyond."""
    flight = Flight("ua_quad_arm4", "base_joint", law="pid")
    action = flight.place()
    flight.fly(action, 8.0, (0.5 * flight.vehicle.mass * GRAVITY, 0.0, 0.0))
    assert flight.base[0] - action[0] > 0.2
    lowest = 0.0
    for _ in range(100):
        flight.fly(action, 0.04)
        lowest = min(lowest, flight.base[0] - action[0])
    assert lowest > -0.1
    assert abs(flight.base[0] - action[0]) < 0.03


def test_gains_of_a_double_integrator_have_their_closed_form() -> None:
    """ẍ = u / m with weights q₁, q₂, r: k₁ = √(q₁/r), k₂ = √(q₂/r + 2 m k₁)."""
    mass, q, r = 2.3, np.diag([40.0, 1.5]), np.array([[0.01]])
    gain = lqr.regulator(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0 / mass]]), q, r)
    first = np.sqrt(40.0 / 0.01)
    np.testing.assert_allclose(gain, [[first, np.sqrt(1.5 / 0.01 + 2.0 * mass * first)]], rtol=1e-9)


def test_the_gains_of_a_chain_of_four_are_those_of_butterworth() -> None:
    """With a weight on the last of four integrators alone the poles lie on a circle: s⁴ + 2.613 s³ + 3.414 s² + ..."""
    chain, enter = np.eye(4, k=1), np.array([[0.0], [0.0], [0.0], [1.0]])
    gain = lqr.regulator(chain, enter, np.diag([1.0, 0.0, 0.0, 0.0]), np.eye(1))
    np.testing.assert_allclose(gain, [[1.0, 2.6131, 3.4142, 2.6131]], atol=1e-4)


@each_vehicle
def test_the_feedback_is_stable_and_uses_what_there_is(vehicle: Vehicle) -> None:
    body, gain = hover_body(vehicle), lqr.feedback_matrix(vehicle)
    a, b = lqr.hover_model(body.mass, body.inertia)
    assert np.linalg.eigvals(a - b @ gain).real.max() < -1.0 * vehicle.agility
    assert (gain[:2] == 0.0).all() == (vehicle.lateral_limit == 0.0)
    vertical = vehicle.agility**2 * body.mass * lqr.LARGEST_LIFT / lqr.LARGEST_POSITION
    assert gain[2, 2] == pytest.approx(vertical, rel=1e-6), "height is a double integrator by itself"


@each_vehicle
def test_the_hovering_body_is_mujocos(vehicle: Vehicle) -> None:
    model = compile_nominal(vehicle)
    data = mujoco.MjData(model)
    data.qpos[3], data.qpos[7:] = 1.0, vehicle.rest_down
    mujoco.mj_forward(model, data)
    body, full = hover_body(vehicle), np.zeros((model.nv, model.nv))
    for k in range(model.nv):
        mujoco.mj_mulM(model, data, full[k], np.eye(model.nv)[k])
    arm = body.com
    about_origin = body.inertia + body.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    assert body.mass == pytest.approx(full[0, 0])
    np.testing.assert_allclose(body.com, data.subtree_com[1], atol=1e-12)
    np.testing.assert_allclose(about_origin, full[3:6, 3:6], atol=1e-12)
