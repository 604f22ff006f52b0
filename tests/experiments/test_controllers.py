"""The comparison of flight laws measures what it says, in a tiny setting."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from aerial_il.core.errors import InvalidValueError
from experiments.controllers.steps import step_figures
from experiments.controllers.study import Controllers

DT = 0.01


def second_order(damping: float, omega: float = 4.0) -> np.ndarray:
    """Unit step response of a second-order system, sampled for 6 s."""
    t = DT * np.arange(1, 601)
    fast = omega * np.sqrt(1.0 - damping**2)
    phase = np.arccos(damping)
    return 1.0 - np.exp(-damping * omega * t) * np.sin(fast * t + phase) / np.sin(phase)


@pytest.mark.parametrize("damping", [0.4, 0.6, 0.8])
def test_a_second_order_system_is_that_of_the_textbook(damping: float) -> None:
    found = step_figures(second_order(damping), DT)
    overshoot = 100.0 * np.exp(-np.pi * damping / np.sqrt(1.0 - damping**2))
    assert found.overshoot_percent == pytest.approx(overshoot, abs=0.1)
    assert found.rise_s == pytest.approx((2.16 * damping + 0.60) / 4.0, rel=0.1), "a rule of thumb for 0.3 to 0.8"
    assert found.settling_s < 3.2 / (damping * 4.0)
    assert found.offset_percent < 0.1


def test_a_response_that_does_not_settle_is_said_so() -> None:
    with pytest.raises(InvalidValueError, match=r"does not settle within 1 s: it ends at 50 %"):
        step_figures(np.linspace(0.0, 0.5, 100), DT)


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
