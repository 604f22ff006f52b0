"""What is said about a configuration leads back to it."""

from __future__ import annotations

import pytest

from aerial_il.cli import commands
from aerial_il.cli.configuration import spelling
from aerial_il.cli.configuration.compose import compose

TRAIN = commands.find("train")
NEEDED = ["dataset=x", "run=y"]


@pytest.mark.parametrize(
    "typed",
    [
        [],
        ["policy.hidden=[64,32]"],
        ["algorithm.steps=7", "algorithm.minutes=0.5"],
        ["policy.ensemble=null", "policy.loss=l2"],
    ],
)
def test_words_and_configuration_are_equivalent(typed: list[str]) -> None:
    config = compose(TRAIN, [*NEEDED, *typed])
    said = spelling.of_group("policy", config.policy, default="mlp")
    said += spelling.of_group("algorithm", config.algorithm, default="bc")
    assert sorted(said) == sorted(typed)
    assert compose(TRAIN, [*NEEDED, *said]) == config
