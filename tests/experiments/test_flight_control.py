"""Studies of flight laws and of flying by learning: manoeuvres measure what they say, and a failure is seen."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from aerial_il.control.vehicle import GRAVITY
from experiments.controllers.steps import step_figures
from experiments.controllers.study import Controllers
from experiments.flight_control.manoeuvres import (
    Held,
    Mismatch,
    held,
    hold,
    push,
    recovery_s,
    respond,
    response_of,
)
from experiments.flight_control.pilots import LawPilot, PolicyPilot

SEEDS = np.array([10_000, 10_001])
TIMES = 0.02 * np.arange(1, 201)


def test_the_offset_under_too_much_mass_is_what_the_gains_say() -> None:
    """Without an observer a constant force f leaves f / (m kp); see docs/controllers.md."""
    result = hold(LawPilot("geometric"), "calm", SEEDS, threads=1, mismatch=Mismatch(mass=1.3))
    assert result.rmse_cm == pytest.approx(100.0 * 0.3 * GRAVITY / 20.0, rel=0.06)
    assert result.power == pytest.approx(1.3**1.5, rel=0.02)
    assert result.crashed == 0.0


def test_a_weak_motor_is_met_by_that_motor_alone() -> None:
    nominal, weak = (
        hold(LawPilot("pid"), "calm", SEEDS, threads=1, mismatch=Mismatch(motor=motor)) for motor in (1.0, 0.8)
    )
    assert nominal.power == pytest.approx(1.0, rel=0.01)
    assert weak.power == pytest.approx((3.0 + 1.25**1.5) / 4.0, rel=0.02), "it is commanded as much more as it lacks"


@pytest.mark.parametrize("step", ["forward", "heading", "attitude"])
def test_a_law_makes_every_step(step: str) -> None:
    response = response_of(respond(LawPilot("lqr"), step, SEEDS, threads=1))
    assert response.settling_s is not None
    assert response.settling_s < 1.5
    assert response.offset_percent < 3.0


def test_a_push_is_recovered_from() -> None:
    away = push(LawPilot("pid"), SEEDS, threads=1)
    assert 0.1 < away.max() < 0.4
    assert recovery_s(away) is not None
    assert recovery_s(np.full(200, 0.06)) is None


class Idle:
    """Lets the rotors stand."""

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Nothing is remembered."""

    def act(self, obs: Mapping[str, np.ndarray]) -> np.ndarray:
        return np.zeros((len(obs["base_pos"]), 4))


def test_who_does_not_fly_has_no_figures_but_crashes() -> None:
    pilot = PolicyPilot(Idle(), "rotor", "idle")
    assert hold(pilot, "calm", SEEDS, threads=1) == Held(None, None, None, None, 1.0)
    assert np.isnan(push(pilot, SEEDS, threads=1)).all()
    assert response_of(respond(pilot, "forward", SEEDS, threads=1)).settling_s is None


def test_responses_are_measured_as_defined() -> None:
    lag = response_of(1.0 - np.exp(-TIMES / 0.2))
    assert lag.rise_s == pytest.approx(0.2 * np.log(9.0), abs=0.02)
    assert lag.settling_s == pytest.approx(0.2 * np.log(10.0), abs=0.02)
    assert lag.overshoot_percent == 0.0
    swinging = response_of(1.0 - np.exp(-0.5 * TIMES) * np.cos(20.0 * TIMES))
    assert swinging.overshoot_percent > 80.0
    assert swinging.settling_s is None
    assert response_of(np.full(200, 0.8)).rise_s is None


def test_what_comes_after_a_crash_does_not_count() -> None:
    away = np.full((100, 2), 0.01)
    away[50:, 1] = np.nan
    thrust = np.where(np.isnan(away)[..., None], np.nan, 5.0) * np.ones(4)
    result = held(away, away, thrust, 20.0, np.array([False, True]))
    assert result == Held(1.0, 0.57, 1.0, 0.0, 0.5)


DT = 0.01


def second_order(damping: float, omega: float = 4.0) -> np.ndarray:
    """Unit step response of a second-order system, sampled for 6 s."""
    t = DT * np.arange(1, 601)
    fast = omega * np.sqrt(1.0 - damping**2)
    phase = np.arccos(damping)
    return 1.0 - np.exp(-damping * omega * t) * np.sin(fast * t + phase) / np.sin(phase)


@pytest.mark.parametrize("damping", [0.4, 0.6, 0.8])
def test_a_second_order_system_is_that_of_the_textbook(damping: float) -> None:
    result = step_figures(second_order(damping), DT)
    overshoot = 100.0 * np.exp(-np.pi * damping / np.sqrt(1.0 - damping**2))
    assert result.overshoot_percent == pytest.approx(overshoot, abs=0.1)
    assert result.rise_s == pytest.approx((2.16 * damping + 0.60) / 4.0, rel=0.1), "a rule of thumb for 0.3 to 0.8"
    assert result.settling_s < 3.2 / (damping * 4.0)
    assert result.offset_percent < 0.1


def test_every_law_has_its_row_its_steps_and_its_tracking(tmp_path: Path) -> None:
    settings = Controllers(
        robots=("fa_hexa_arm4",), controllers=("geometric_observer", "lqr"), tiers=("calm",), seeds=1, settle_s=3.0,
        step_s=3.0, tracking_s=0.5, threads=1,
    )  # fmt: skip
    report = settings.run(tmp_path, progress=False)
    rows = report.tables["Flight laws"]
    assert [row["controller"] for row in rows] == ["geometric_observer", "lqr"]
    assert all(0.0 < row["hover_calm_cm"] < 8.0 and row["position_settling_s"] < 2.5 for row in rows)
    assert set(report.figures) == {"steps.svg", "tracking.svg"}
    assert all(target.met for target in report.targets)
    json.dumps(report.to_dict(), allow_nan=False)
