"""Configuration and registries agree, and everything in ``conf/`` composes and builds."""

from __future__ import annotations

import ast
import dataclasses
from collections import defaultdict
from collections.abc import Mapping
from itertools import zip_longest
from pathlib import Path

import pytest

import aerial_il
from aerial_il import algorithms, benchmarks, policies
from aerial_il.cli import commands
from aerial_il.cli.configuration import defaults, groups, keys
from aerial_il.cli.configuration.build import build, locate, parameters
from aerial_il.cli.configuration.compose import compose
from aerial_il.cli.configuration.defaults import defaults_of
from aerial_il.cli.configuration.overrides import known_keys
from aerial_il.cli.sweeps.sweep import launcher_of, parted
from aerial_il.control import controllers
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.suite import tiers
from experiments.from_prior.study import FEWER, SHORTER

REGISTRIES = {
    "robot": aerial_il.list_robots(),
    "task": aerial_il.list_tasks(),
    "tier": tiers.names(),
    "controller": controllers.names(),
    "policy": policies.names(),
    "algorithm": algorithms.names(),
    "bench": benchmarks.names(),
}
TARGETS = [
    (group, name)
    for group in groups.groups()
    for name in groups.options(group)
    if "_target_" in groups.read_option(group, name)
]
REGISTERED = [(group, name) for group, (_, names, _) in groups.CONSTRUCTED.items() for name in names()]
FILES = [file for group in groups.CONSTRUCTED for file in sorted((groups.conf_dir() / group).glob("*.yaml"))]
CHOICES = [
    (command, group, option)
    for command in commands.names()
    for group in commands.find(command).choices
    for option in groups.options(group)
]
ONCE = {(group, option): (command, group, option) for command, group, option in reversed(CHOICES)}
FIRST = {(command, group): (command, group, option) for command, group, option in reversed(CHOICES)}
BRIEFLY = sorted({*ONCE.values(), *FIRST.values()})  # each option in one command, each group of each command


def together() -> list[tuple[str, list[str]]]:
    """Return commands with words that choose one option of each of their groups, until every brief choice is made.

    An experiment, which changes what other groups say, is chosen alone.
    """
    composed = list[tuple[str, list[str]]]()
    for command in dict.fromkeys(command for command, _, _ in BRIEFLY):
        words = defaultdict[str, list[str]](list)
        for _, group, option in (choice for choice in BRIEFLY if choice[0] == command):
            words[group].append(f"{group}={option}")
        composed += [(command, [word]) for word in words.pop("experiment", [])]
        composed += [(command, [w for w in each if w is not None]) for each in zip_longest(*words.values())]
    return composed


@pytest.mark.parametrize("group", REGISTRIES)
def test_each_registered_name_may_be_chosen(group: str) -> None:
    """A policy, an algorithm or a benchmark may have further choices: the same thing with other values."""
    registered, choices = set(REGISTRIES[group]), set(groups.options(group))
    assert registered <= choices
    if group not in groups.CONSTRUCTED:
        assert registered == choices
        assert all(groups.read_option(group, name) == {"name": name} for name in choices)


@pytest.mark.parametrize(("group", "name"), TARGETS)
def test_a_choice_names_exactly_what_its_constructor_takes_and_builds(group: str, name: str) -> None:
    content = groups.read_option(group, name)
    assert set(content) - {"_target_"} == set(parameters(content["_target_"])), "each key can be given without a plus"
    build(content)


def plain(value: object) -> object:
    """Return a tree of settings with the name of each class, lists for tuples."""
    if dataclasses.is_dataclass(value):
        return type(value).__name__, {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {name: plain(inner) for name, inner in value.items()}
    return [plain(inner) for inner in value] if isinstance(value, (list, tuple)) else value


@pytest.mark.parametrize(("group", "name"), REGISTERED)
def test_defaults_read_from_the_source_are_those_of_the_constructor(group: str, name: str) -> None:
    target = groups.target_of(group, name)
    assert plain(build(defaults_of(target))) == plain(locate(target)())


def test_a_mapping_that_unpacks_what_is_computed_is_refused_and_one_that_unpacks_a_constant_is_read() -> None:
    """Of two constants of one module."""
    home = "experiments.from_prior.study"
    read = defaults._value(ast.parse("{**SHORTER, 'more': FEWER['dapg']}", mode="eval").body, home)
    assert read == {**SHORTER, "more": FEWER["dapg"]}
    home = "aerial_il.benchmarks.parts.records.fingerprint"
    with pytest.raises(InvalidValueError, match=r"\*\*ROOMS.* cannot be read without running it: name it"):
        defaults._value(ast.parse("{**ROOMS}", mode="eval").body, home)


@pytest.mark.parametrize("file", FILES, ids=lambda file: "/".join(file.with_suffix("").parts[-2:]))
def test_a_file_repeats_nothing_that_its_constructor_says_anyway(file: Path) -> None:
    said = {name: value for name, value in groups.read_yaml(file).items() if name not in ("_target_", "defaults")}
    content = groups.read_option(file.parent.name, file.stem)
    usual = defaults_of(content["_target_"])
    assert not {name for name, value in said.items() if not isinstance(value, dict) and usual[name] == value}


def test_a_file_may_say_only_what_differs_from_another_of_its_group(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "policy").mkdir()
    target = groups.target_of("policy", "mlp")
    (tmp_path / "policy" / "wide.yaml").write_text(f"_target_: {target}\nhidden: [64, 64]\nchunk: 3\n")
    (tmp_path / "policy" / "wide_short.yaml").write_text("defaults: [wide, _self_]\nchunk: 2\n")
    (tmp_path / "policy" / "lost.yaml").write_text("defaults: [wid, _self_]\n")
    monkeypatch.setattr(groups, "conf_dir", lambda: tmp_path)
    wide, short = (groups.read_option("policy", name) for name in ("wide", "wide_short"))
    assert (short["hidden"], short["chunk"]) == ([64, 64], 2)
    assert {key for key in wide if wide[key] != short[key]} == {"chunk"}
    with pytest.raises(UnknownNameError, match="Did you mean 'wide'"):
        groups.read_option("policy", "lost")


def test_nested_settings_of_a_file_change_those_of_the_one_it_builds_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "bench").mkdir()
    target = groups.target_of("bench", "beyond_teacher")
    first = f"_target_: {target}\npractising: {{steps: 10, gamma: 0.9}}\ndemos: 5\n"
    (tmp_path / "bench" / "first.yaml").write_text(first)
    (tmp_path / "bench" / "second.yaml").write_text("defaults: [first, _self_]\npractising: {gamma: 0.8}\n")
    monkeypatch.setattr(groups, "conf_dir", lambda: tmp_path)
    found = groups.read_option("bench", "second")
    assert (found["practising"]["steps"], found["practising"]["gamma"], found["demos"]) == (10, 0.8, 5)


@pytest.mark.parametrize("name", policies.names())
def test_a_policy_file_of_that_name_builds_that_policy(name: str) -> None:
    assert type(build(groups.read_option("policy", name))) is policies.get(name)


def test_the_brief_choices_leave_out_no_option_and_no_group() -> None:
    assert {(group, option) for _, group, option in BRIEFLY} == {(group, option) for _, group, option in CHOICES}
    assert {(command, group) for command, group, _ in BRIEFLY} == {(command, group) for command, group, _ in CHOICES}
    chosen = [(command, *word.split("=")) for command, words in together() for word in words]
    assert sorted(chosen) == BRIEFLY


@pytest.mark.parametrize(
    ("command", "words"),
    [*together(), *(pytest.param(c, [f"{group}={option}"], marks=pytest.mark.slow) for c, group, option in CHOICES)],
    ids=lambda value: value if isinstance(value, str) else "+".join(value),
)
def test_every_choice_of_every_command_composes(command: str, words: list[str]) -> None:
    """Several at once, each of another group; each by itself (slow)."""
    found = commands.find(command)
    assert isinstance(compose(found, [*_required(command), *words]), found.config)


@pytest.mark.parametrize("name", commands.names())
def test_a_command_explains_itself_and_each_of_its_keys(name: str) -> None:
    command = commands.find(name)
    assert command.summary.endswith((".", "continues."))
    assert "Example: aerial-il " in command.doc
    assert all(field.metadata["help"] for field in dataclasses.fields(command.config))
    assert set(known_keys(command, command.choices)) >= {f.name for f in dataclasses.fields(command.config)}


@pytest.mark.parametrize("name", commands.names())
def test_the_examples_of_a_command_are_valid(name: str) -> None:
    command = commands.find(name)
    for line in command.doc.splitlines():
        if line.startswith(f"Example: aerial-il {name}"):
            launched, words = parted(line.split()[3:])
            compose(command, words)
            launcher_of(launched)


def _required(name: str) -> list[str]:
    """Return the least that a command needs to be told."""
    declared = dataclasses.fields(commands.find(name).config)
    plain = [f"{f.name}=x" for f in declared if not keys.is_group(f) and not keys.default_text(f)]
    return plain + [f"{f.name}.path=x" for f in declared if keys.is_group(f) and keys.takes_path(f)]
