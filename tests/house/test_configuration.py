"""Configuration and registries agree, and everything in ``conf/`` composes and builds."""

from __future__ import annotations

import dataclasses

import pytest

import aerial_il
from aerial_il import algorithms, benchmarks, policies
from aerial_il.cli import commands
from aerial_il.cli.configuration import groups as conf
from aerial_il.cli.configuration import keys
from aerial_il.cli.configuration.build import build, parameters
from aerial_il.cli.configuration.compose import compose
from aerial_il.cli.configuration.overrides import known_keys
from aerial_il.control import laws
from aerial_il.suite import tiers

REGISTRIES = {
    "robot": aerial_il.list_robots(),
    "task": aerial_il.list_tasks(),
    "tier": tiers.names(),
    "controller": laws.names(),
    "policy": policies.list_policies(),
    "algorithm": algorithms.list_algorithms(),
    "bench": benchmarks.names(),
}
TARGETS = [
    (group, name)
    for group in conf.groups()
    for name in conf.options(group)
    if "_target_" in conf.read_option(group, name)
]
CHOICES = [
    (command, group, option)
    for command in commands.names()
    for group in conf.default_choices(command)
    for option in conf.options(group)
]


@pytest.mark.parametrize("group", REGISTRIES)
def test_each_registered_name_has_a_file_and_each_file_a_registered_name(group: str) -> None:
    """A policy or an algorithm may have further files: the same thing with other values."""
    registered, files = set(REGISTRIES[group]), set(conf.options(group))
    assert registered <= files
    if group in ("robot", "task", "tier", "controller"):
        assert registered == files
        assert all(conf.read_option(group, name) == {"name": name} for name in files)


@pytest.mark.parametrize(("group", "name"), TARGETS)
def test_a_file_names_exactly_what_its_constructor_takes_and_builds(group: str, name: str) -> None:
    content = conf.read_option(group, name)
    assert set(content) - {"_target_"} == set(parameters(content["_target_"])), "each key can be given without a plus"
    build(content)


@pytest.mark.parametrize("name", policies.list_policies())
def test_a_policy_file_of_that_name_builds_that_policy(name: str) -> None:
    assert type(build(conf.read_option("policy", name))) is policies.policy_config(name)


@pytest.mark.parametrize(("command", "group", "option"), CHOICES)
def test_every_choice_of_every_command_composes(command: str, group: str, option: str) -> None:
    found = commands.find(command)
    chosen = compose(found, [*_required(command), f"{group}={option}"])
    assert isinstance(chosen, found.config)


@pytest.mark.parametrize("name", commands.names())
def test_a_command_explains_itself_and_each_of_its_keys(name: str) -> None:
    command = commands.find(name)
    assert command.summary.endswith((".", "continues."))
    assert "Example: aerial-il " in command.doc
    assert (conf.conf_dir() / f"{name}.yaml").exists()
    assert all(field.metadata["help"] for field in dataclasses.fields(command.config))
    assert set(known_keys(command, conf.default_choices(name))) >= {f.name for f in dataclasses.fields(command.config)}


@pytest.mark.parametrize("name", commands.names())
def test_the_examples_of_a_command_are_valid(name: str) -> None:
    command = commands.find(name)
    for line in command.doc.splitlines():
        if line.startswith(f"Example: aerial-il {name}"):
            compose(command, line.split()[3:])


def _required(name: str) -> list[str]:
    """Return the least that a command needs to be told."""
    declared = dataclasses.fields(commands.find(name).config)
    plain = [f"{f.name}=x" for f in declared if not keys.is_group(f) and not keys.default_text(f)]
    return plain + [f"{f.name}.path=x" for f in declared if keys.is_group(f) and keys.takes_path(f)]
