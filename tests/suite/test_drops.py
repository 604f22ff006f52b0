"""Nothing passes through a table: every loose object of every task, dropped again and again."""

from __future__ import annotations

from collections import Counter

import mujoco
import pytest

from tests.suite.drops import drop, loose_objects, places_of, props_of

each_object = pytest.mark.parametrize(("task", "joint"), loose_objects())
FEW, MANY = 40, 1000


def faults(task: str, joint: str, model: mujoco.MjModel, drops: int) -> Counter[str]:
    """How often each fault occurred, and how often none did."""
    places = places_of(task)
    return Counter(name for seed in range(drops) for name in drop(model, joint, places, seed).faults or ("none",))


@each_object
@pytest.mark.parametrize("drops", [FEW, pytest.param(MANY, marks=pytest.mark.slow)])
def test_what_is_dropped_comes_to_rest_on_top(task: str, joint: str, drops: int) -> None:
    assert faults(task, joint, props_of(task).compile(), drops) == {"none": drops}


def test_loose_objects_are_listed() -> None:
    assert {("pick_place", "cube"), ("insert_peg", "peg")} <= set(loose_objects())


def test_a_soft_thin_table_lets_things_through() -> None:
    """The check can fail: a peg without balls for noses, over boards as soft as MuJoCo makes them by itself."""
    spec = props_of("insert_peg")
    for geom in spec.geoms:
        geom.solref, geom.solimp, geom.solmix = [0.02, 1.0], [0.9, 0.95, 0.001, 0.5, 2.0], 1.0
    top = spec.geom("table")
    top.pos[2], top.size[2] = top.pos[2] + top.size[2] - 0.015, 0.015
    for name in ("peg_nose", "peg_tail"):
        spec.delete(spec.geom(name))
    assert faults("insert_peg", "peg", spec.compile(), FEW)["passed through"] > 0.1 * FEW


def test_springs_without_damping_give_no_rest() -> None:
    """The check can fail: without friction or damping in the contact, an object bounces on and on."""
    spec = props_of("pick_place")
    for geom in spec.geoms:
        geom.solref, geom.solmix = [-2e4, 0.0], 1.0
    found = faults("pick_place", "cube", spec.compile(), FEW)
    assert found["not at rest"] + found["gained energy"] + found["bounced higher than it fell from"] > 0.1 * FEW
