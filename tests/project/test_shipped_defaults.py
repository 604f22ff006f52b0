"""The commands as they are typed without a further word do what the studies measured."""

from __future__ import annotations

import pytest

from aerial_il.cli import commands
from aerial_il.cli.configuration import groups
from aerial_il.cli.configuration.compose import compose

STUDY = groups.read_option("bench", "imitation")


def test_training_without_a_word_is_the_training_of_the_study() -> None:
    shipped = compose(commands.find("train"), ["dataset=datasets/x", "run=runs/y"])
    assert shipped.policy == STUDY["policies"]["mlp"]
    assert shipped.algorithm == STUDY["algorithms"]["mlp"]


@pytest.mark.parametrize("study", ["imitation", "learning_curve"])
@pytest.mark.parametrize("command", ["collect", "demo"])
def test_the_expert_demonstrates_as_in_the_studies(command: str, study: str) -> None:
    shipped = compose(commands.find(command), ["out=datasets/x"])
    assert shipped.expert.noise == groups.read_option("bench", study)["expert"]["noise"]


def test_the_demonstration_run_learns_as_the_study_does() -> None:
    demo = compose(commands.find("demo"), [])
    assert (demo.policy, demo.algorithm) == (STUDY["policies"]["mlp"], STUDY["algorithms"]["mlp"])
