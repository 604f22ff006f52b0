"""Studies fly what the commands of the README fly: their settings are the shipped defaults."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import pytest

from aerial_il.algorithms.bc import BC
from aerial_il.core import registry
from aerial_il.policies.mlp import MLP
from aerial_il.workflows.collect import Expert
from aerial_il.workflows.train import Train
from experiments.controllers.study import Controllers
from experiments.dagger.study import Dagger
from experiments.imitation.study import DEFAULT, Imitation
from experiments.learning_curve.study import LearningCurve


def test_training_without_a_word_is_the_training_of_the_studies() -> None:
    usual: Any = {field.name: field.default for field in fields(Train)}
    assert (usual["policy"], usual["algorithm"]) == (DEFAULT, "bc")
    study, curve, asking = Imitation(), LearningCurve(), Dagger()
    assert study.policies[DEFAULT] == curve.policy == asking.policy == MLP()
    assert study.algorithms[DEFAULT] == curve.algorithm == asking.cloning == BC()


@pytest.mark.parametrize("study", ["imitation", "learning_curve", "dagger", "from_prior", "pixels", "lerobot"])
def test_the_expert_demonstrates_as_collect_has_it(study: str) -> None:
    assert registry.get("study", study)().noise == Expert().noise


def test_the_study_of_controllers_flies_every_law() -> None:
    assert set(Controllers().controllers) == set(registry.names("controller"))
