"""Studies fly what the commands of the README fly: their settings are the shipped defaults, read from one place."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import yaml
from aerial_il.cli.configuration import groups
from aerial_il.cli.configuration.build import build

from aerial_il.cli import commands
from aerial_il.control import controllers
from experiments.controllers.study import Controllers
from experiments.imitation import study as imitation
from experiments.tracking import study as tracking

CLONING = ("imitation", "learning_curve", "dagger")  # studies of what `collect` and `train` do if nothing is said
DEMONSTRATING = (*CLONING, "pixels", "lerobot")


def composed(name: str) -> Iterator[tuple[str, str, str]]:
    """Yield (group, key, file) of what a study takes from other groups."""
    text = yaml.safe_load((groups.conf_dir() / "bench" / f"{name}.yaml").read_text())
    for entry in text["defaults"]:
        if isinstance(entry, dict):
            ((source, chosen),) = entry.items()
            group, _, key = source.removeprefix("/").partition("@")
            yield group, key, chosen


def at(tree: dict[str, Any], key: str) -> Any:
    for part in key.split("."):
        tree = tree[part]
    return tree


@pytest.mark.parametrize("name", DEMONSTRATING)
def test_the_expert_demonstrates_as_collect_has_it(name: str) -> None:
    usual = commands.find("collect").choices["expert"]
    assert [chosen for group, _, chosen in composed(name) if group == "expert"] == [usual]
    assert build(groups.read_option("bench", name)).expert == groups.read_option("expert", str(usual))


def test_the_study_of_controllers_flies_every_law() -> None:
    assert sorted(Controllers().controllers) == list(controllers.names())
    assert {tracking.DEFAULT, tracking.UNOBSERVED} <= set(controllers.names())


@pytest.mark.parametrize("name", [*CLONING, "pixels"])
def test_what_is_composed_is_taken_as_it_is(name: str) -> None:
    settings = groups.read_option("bench", name)
    for group, key, chosen in composed(name):
        assert at(settings, key) == groups.read_option(group, chosen), f"{name}.yaml changes {group}={chosen}"


@pytest.mark.parametrize("name", CLONING)
def test_the_default_class_and_algorithm_are_those_of_train(name: str) -> None:
    usual = commands.find("train").choices
    taken = {(group, chosen) for group, _, chosen in composed(name)}
    assert {("policy", usual["policy"]), ("algorithm", usual["algorithm"])} <= taken
    assert usual["policy"] == imitation.DEFAULT
