"""What presses against the tool is felt by the joints, and the arm goes along with it, not against it."""

import numpy as np
import pytest

from aerial_il.control import controller_state as layout
from aerial_il.control.contact import FELT_SHARE, LEAST_N, give_way
from aerial_il.control.scratch import make_scratch
from aerial_il.control.vehicle import GRAVITY, Gains, Vehicle, record_of
from aerial_il.control.whole_body import seat_references, solve_arm
from aerial_il.core.rotations import IDENTITY
from tests.control.nominal import VEHICLES

DT, BASE = 0.004, (0.0, 0.0, 1.5)
ARMED = {name: vehicle for name, vehicle in VEHICLES.items() if vehicle.num_joints >= 4}


def seated(vehicle: Vehicle) -> tuple[np.ndarray, np.record]:
    state, scratch = np.zeros(layout.CONTROLLER_STATE_SIZE), make_scratch()
    seat_references(vehicle.record, scratch, state, BASE, IDENTITY, 0.0, vehicle.rest_down.copy())
    return state, scratch


def weight(vehicle: Vehicle) -> float:
    return GRAVITY * float(vehicle.base_mass + vehicle.link_mass.sum())


@pytest.mark.parametrize("name", ARMED)
def test_the_joints_lag_says_which_force_presses(name: str) -> None:
    vehicle, force = ARMED[name], np.array([1.0, -0.5, 8.0])
    state, scratch = seated(vehicle)
    gains, joints = record_of(Gains().fitted(vehicle)), slice(layout.JOINT_CMD, layout.JOINT_CMD + vehicle.num_joints)
    lag = np.zeros(vehicle.num_joints)
    for _ in range(200):
        solve_arm(vehicle.record, gains, scratch, state, BASE, IDENTITY, state[joints] - lag, DT)
        lag = -scratch.jacobian[:3, 4 : 4 + lag.size].T @ force / vehicle.joint_stiffness
    felt = state[layout.CONTACT : layout.CONTACT + 3]
    assert felt == pytest.approx(force, rel=0.25, abs=0.8), "less where it is nearly stretched"


@pytest.mark.parametrize("name", ARMED)
def test_it_gives_way_along_the_force_alone(name: str) -> None:
    vehicle = ARMED[name]
    state, _ = seated(vehicle)
    moved = (BASE[0] + 0.02, BASE[1], BASE[2] + 0.1)
    for share, given in ((0.0, 0.0), (0.9, 0.0), (1.5, 0.05), (2.0, 0.1), (9.0, 0.1)):
        least = max(LEAST_N, FELT_SHARE * weight(vehicle))
        state[layout.CONTACT : layout.CONTACT + 3] = [0.0, 0.0, share * least]
        assert give_way(vehicle.record, state, moved) == pytest.approx([0.0, 0.0, given])
    assert give_way(vehicle.record, state, (BASE[0], BASE[1], BASE[2] - 0.1)) == (0.0, 0.0, 0.0), "it is no push"
