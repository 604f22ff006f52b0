"""The commands as they are typed without a further word do what the studies measured."""

from __future__ import annotations

import pytest

from aerial_il.algorithms.bc import BC
from aerial_il.cli import commands
from aerial_il.cli.configuration import groups
from aerial_il.control import laws
from aerial_il.core import registry
from aerial_il.policies.mlp import MLP
from aerial_il.workflows.train import Train
from experiments.controllers.study import Controllers
from experiments.dagger.study import Dagger
from experiments.imitation.study import DEFAULT, Imitation
from experiments.learning_curve.study import LearningCurve


def test_training_without_a_word_is_the_training_of_the_studies() -> None:
    assert Train.CHOICES == {"policy": DEFAULT, "algorithm": "bc"}
    study, curve, asking = Imitation(), LearningCurve(), Dagger()
    assert study.policies[DEFAULT] == curve.policy == asking.policy == MLP()
    assert study.algorithms[DEFAULT] == curve.algorithm == asking.cloning == BC()


@pytest.mark.parametrize("study", ["imitation", "learning_curve", "dagger", "from_prior", "pixels", "lerobot"])
@pytest.mark.parametrize("command", ["collect", "demo"])
def test_the_expert_demonstrates_as_in_the_studies(command: str, study: str) -> None:
    usual = groups.read_option("expert", str(commands.find(command).choices["expert"]))
    assert usual["noise"] == registry.get("study", study)().noise


def test_the_study_of_controllers_flies_every_law() -> None:
    assert Controllers().controllers == laws.names()
