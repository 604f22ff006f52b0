"""Every registered flight law: it hovers, keeps to its own memory, and says what it is."""

from __future__ import annotations

import numpy as np
import pytest

from aerial_il import robots
from aerial_il.control import controller_state as layout
from aerial_il.control.scratch import make_scratch
from aerial_il.control.vehicle import record_of
from aerial_il.core import registry
from tests.control.in_the_air import Flight

each_law = pytest.mark.parametrize("law", registry.names("controller"))
each_robot = pytest.mark.parametrize("robot", ["ua_quad_arm4", "fa_hexa_arm4"])


@each_law
def test_it_says_what_it_is(law: str) -> None:
    assert len(registry.get("controller", law).summary.split()) >= 3
    assert all(np.isfinite(gain) for gain in registry.get("controller", law)().gains)


@each_law
@each_robot
def test_it_brings_the_base_to_its_reference_and_holds_it(law: str, robot: str) -> None:
    flight = Flight(robot, "base_joint", law=law)
    action = flight.place()
    action[:3] += [0.3, -0.2, 0.1]
    flight.fly(action, 6.0)
    assert np.linalg.norm(flight.base - action[:3]) < 0.03
    assert np.linalg.norm(flight.data.qvel[:3]) < 0.05


@each_law
@each_robot
def test_its_kernel_keeps_to_its_own_memory(law: str, robot: str) -> None:
    vehicle = robots.get(robot).vehicle
    result, settings = [], registry.get("controller", law)()
    own = settings.record(vehicle).view(np.recarray)[0]
    compiled = registry.kernel("controller", law, "steer")
    for steer in (compiled.py_func, compiled):
        scratch, state = make_scratch(), np.zeros(layout.CONTROLLER_STATE_SIZE)
        scratch.base_rot[[0, 4, 8]], scratch.base_pos[2], scratch.dt = 1.0, 1.0, 0.004
        state[layout.BASE_POS : layout.BASE_POS + 3] = [0.05, -0.02, 1.01]
        before = state.copy()
        for _ in range(3):
            steer(own, vehicle.record, record_of(settings.gains.fitted(vehicle)), scratch, state)
        before[layout.LAW : layout.LAW + layout.LAW_SIZE] = state[layout.LAW : layout.LAW + layout.LAW_SIZE]
        np.testing.assert_array_equal(state, before, err_msg=f"{law} writes beyond its own memory")
        result.append(np.concatenate([scratch.force, scratch.torque, state]))
        assert np.isfinite(result[-1]).all()
        assert scratch.force[2] > 0.5 * vehicle.mass * 9.81, "it carries the weight"
    np.testing.assert_allclose(*result, rtol=1e-10, atol=1e-10)
