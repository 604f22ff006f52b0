"""Thrust is let go by a vehicle that is held, sent down and does not fall; by no other, and not for a moment longer."""

import numpy as np
import pytest

from aerial_il.control import controller_state as layout
from aerial_il.control.standing import BELOW_M, FADE_S, STILL_M_S, SURE_S, let_go

DT, HEIGHT = 0.004, 1.0
REST = (0.0, 0.0, 0.0)


def told(*, below: float = BELOW_M + 0.01, closed: float = 1.0) -> np.ndarray:
    """Memory of a controller whose reference is ``below`` the base, m."""
    state = np.zeros(layout.CONTROLLER_STATE_SIZE)
    state[layout.BASE_POS + 2], state[layout.CLOSED] = HEIGHT - below, closed
    return state


def share_after(state: np.ndarray, seconds: float, vel: tuple[float, float, float] = REST) -> float:
    share = 0.0
    for _ in range(round(seconds / DT)):
        share = let_go(state, (0.0, 0.0, HEIGHT), vel, DT)
    return share


def test_thrust_goes_once_it_is_sure_and_fades() -> None:
    state = told()
    assert share_after(state, SURE_S - DT) == 0.0
    assert share_after(state, 0.5 * FADE_S) == pytest.approx(0.5, abs=0.05)
    assert share_after(state, FADE_S) == 1.0


@pytest.mark.parametrize(
    ("state", "vel"),
    [
        (told(), (0.0, 0.0, -1.1 * STILL_M_S)),
        (told(), (1.1 * STILL_M_S, 0.0, 0.0)),
        (told(below=0.9 * BELOW_M), REST),
        (told(below=-1.0), REST),
        (told(closed=0.5), REST),
    ],
    ids=["falling", "drifting", "hardly sent down", "sent up", "gripper open"],
)
def test_otherwise_it_stays(state: np.ndarray, vel: tuple[float, float, float]) -> None:
    assert share_after(state, 10.0, vel) == 0.0


@pytest.mark.parametrize("change", ["sent up", "falling", "opened"])
def test_it_comes_back_within_a_seventh_of_a_second(change: str) -> None:
    state = told()
    share_after(state, 2.0)
    if change == "sent up":
        state[layout.BASE_POS + 2] = HEIGHT
    state[layout.CLOSED] = 0.0 if change == "opened" else 1.0
    vel = (0.0, 0.0, -1.0) if change == "falling" else REST
    assert share_after(state, 1.0 / 7.0, vel) == 0.0
