"""Shaped motions are smooth, bounded and exact at rest."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerial_il.teleop.input.mapping import MOTIONS, Intent
from aerial_il.teleop.piloting.shaping import ACCELERATION, BRAKING, DEAD_ZONE, Shaper, expo, without_dead_zone


def test_a_key_takes_150_ms_from_rest_to_full() -> None:
    shaper, values = Shaper(), []
    for _ in range(10):
        values.append(shaper.step(Intent(digital={"forward": 1.0}))["forward"])
    assert values[:7] == sorted(values[:7])
    assert values[6] < 1.0
    assert values[7] == pytest.approx(1.0)
    assert values[0] < 0.2


def test_letting_go_ends_in_exact_rest() -> None:
    shaper = Shaper()
    for _ in range(20):
        shaper.step(Intent(digital={"forward": 1.0}))
    values = [shaper.step(Intent())["forward"] for _ in range(6)]
    assert values[-1] == 0.0


@given(st.floats(-DEAD_ZONE, DEAD_ZONE), st.floats(-DEAD_ZONE, DEAD_ZONE))
def test_the_dead_zone_is_round(x: float, y: float) -> None:
    found = without_dead_zone({"forward": x, "lateral": y})
    assert (found["forward"] == 0.0) == (x == 0.0 or (x * x + y * y) ** 0.5 <= DEAD_ZONE) or abs(
        found["forward"]
    ) < 1e-6


def test_outside_the_dead_zone_a_small_sideways_part_is_kept() -> None:
    found = without_dead_zone({"forward": 0.9, "lateral": 0.05})
    assert 0.0 < found["lateral"] < 0.05


@given(st.lists(st.tuples(*[st.floats(-1, 1)] * len(MOTIONS), st.sampled_from([-1.0, 0.0, 1.0])), max_size=40))
def test_shaped_motions_stay_in_bounds_and_never_jump(script: list) -> None:
    shaper, before = Shaper(), dict.fromkeys(MOTIONS, 0.0)
    for *axes, key in script:
        after = shaper.step(Intent(dict(zip(MOTIONS, axes, strict=True)), {"forward": key}))
        assert all(-1.0 <= value <= 1.0 for value in after.values())
        assert all(abs(after[m] - before[m]) <= max(ACCELERATION, BRAKING) + 1e-12 for m in MOTIONS)
        before = dict(after)


def test_expo_keeps_the_ends_and_is_fine_in_the_middle() -> None:
    assert expo(1.0) == 1.0
    assert expo(-1.0) == -1.0
    assert 0.0 < expo(0.2) < 0.2
