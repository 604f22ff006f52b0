"""Studies with the model of a driver learn from its flights as ``aerial-il train`` learns from a person's."""

from __future__ import annotations

from aerial_il.algorithms.bc import BC
from aerial_il.data.waypoints import LOOKAHEAD_S, Waypoints
from experiments.common.stages import Cloned
from experiments.hg_dagger.study import HgDagger
from experiments.human_data.study import TEACHERS, ClonedDriver, HumanData

SUITED = Waypoints(lookahead_s=LOOKAHEAD_S, flown_by="hand")


def test_only_the_drivers_arm_is_suited_to_hands() -> None:
    found = {teacher: training for _, teacher, training in HumanData(arms=("flow",), draws=(0,)).all_trainings()}
    driver, recorded, script = (found[teacher] for teacher in TEACHERS)
    assert isinstance(driver, ClonedDriver)
    assert isinstance(recorded, ClonedDriver)
    assert isinstance(script, Cloned)
    assert (driver.algorithm.waypoints, driver.policy.relative) == (SUITED, True)
    for other in (recorded, script):
        assert (other.algorithm.waypoints, other.policy.relative) == (BC.waypoints, False)
    assert driver.driven == recorded.driven
    assert {training.policy.name for training in found.values()} == {"flow"}


def test_all_rounds_of_taking_over_are_suited_to_hands() -> None:
    study = HgDagger()
    assert study.algorithm.training == study.learner[0]
    assert study.learner[0].waypoints == SUITED
    assert study.learner[1].relative
    plain = HgDagger(by_hand=False)
    assert plain.learner == (plain.training, plain.policy)
