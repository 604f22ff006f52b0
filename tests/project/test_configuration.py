"""Presets, registries and commands agree: everything in ``conf/`` composes, and every key is explained."""

import shlex
from itertools import zip_longest

import pytest

from aerial_il.cli import commands
from aerial_il.cli.compose import compose, settings_of
from aerial_il.cli.known import known, of_choice
from aerial_il.cli.sweeps.sweep import chosen_of
from aerial_il.cli.words import LAUNCHER, SWEEPER, read
from aerial_il.core import presets, registry, schema
from aerial_il.core.composition import build, chosen, plain
from aerial_il.core.schema import Key, keys, options

CHOSEN = ("policy", "algorithm", "gate", "launcher", "sweeper")
NAMES = [(kind, name) for kind in CHOSEN for name in options(kind)]
PRESETS = [(kind, name) for kind in CHOSEN for name in presets.names(kind)]


def choosing(command: str) -> list[Key]:
    """Return the keys of a command at which something is chosen, named, or taken from a preset."""
    every = keys(commands.find(command).settings)
    return [key for key in every if key.kind or (key.takes == "place" and presets.names(key.name))]


def together() -> list[tuple[str, list[str]]]:
    """Return commands with words that choose something at each such key, until everything was chosen somewhere."""
    result = list[tuple[str, list[str]]]()
    for command in commands.names():
        words = {
            key.name: [
                f"{key.name}={option}" for option in (options(key.kind) if key.kind else presets.names(key.name))
            ]
            for key in choosing(command)
        }
        alone = words.pop("experiment", [])
        result += [(command, [word]) for word in alone]
        result += [(command, [w for w in each if w is not None]) for each in zip_longest(*words.values())]
    return result


@pytest.mark.parametrize("kind", ["policy", "algorithm", "gate", "launcher", "sweeper"])
def test_each_registered_name_may_be_chosen(kind: str) -> None:
    assert set(registry.names(kind)) <= set(options(kind))
    assert all(type(chosen(kind, name)) is registry.get(kind, name) for name in registry.names(kind))


@pytest.mark.parametrize(("kind", "name"), NAMES)
def test_settings_are_made_again_of_their_plain_values(kind: str, name: str) -> None:
    settings = chosen(kind, name)
    assert build(type(settings), plain(settings)) == settings


@pytest.mark.parametrize(("kind", "name"), NAMES)
def test_every_setting_of_a_choice_is_explained(kind: str, name: str) -> None:
    assert [key.name for key in of_choice(kind, name) if not key.meaning] == []


@pytest.mark.parametrize(("kind", "name"), PRESETS)
def test_a_preset_repeats_no_default(kind: str, name: str) -> None:
    said = presets.read(kind, name)
    default = plain(registry.get(kind, said.pop("name", name))())
    assert {key for key, value in said.items() if default[key] == value} == set()


@pytest.mark.parametrize(
    ("command", "words"), together(), ids=lambda value: value if isinstance(value, str) else "+".join(value)
)
def test_every_choice_of_every_command_composes(command: str, words: list[str]) -> None:
    result = commands.find(command)
    said = {word.partition("=")[0] for word in words}
    needed = [key for key in keys(result.settings) if not key.default and key.name not in said]
    least = [f"{key.name}={key.options[0] if key.options else 'x'}" for key in needed]
    assert isinstance(compose(result, [*least, *words]), result.settings)


@pytest.mark.parametrize("name", commands.names())
def test_a_command_explains_itself_and_each_of_its_keys(name: str) -> None:
    command = commands.find(name)
    assert command.summary.endswith(".")
    assert "Example: aerial-il " in command.doc
    assert [key.name for key in keys(command.settings) if not key.meaning] == []
    assert {*command.bare, *filter(None, [command.output])} <= {key.name for key in keys(command.settings)}


@pytest.mark.parametrize("name", commands.names())
def test_the_examples_of_a_command_are_valid(name: str) -> None:
    command = commands.find(name)
    for line in command.doc.splitlines():
        if line.startswith(f"Example: aerial-il {name}"):
            words = [
                word for word in shlex.split(line)[3:] if not word.startswith("from=")
            ]  # of a run that is not here
            said = read(command, words)
            settings_of(command, said.overrides)
            chosen_of(LAUNCHER, said.apart[LAUNCHER])
            chosen_of(SWEEPER, said.apart[SWEEPER])


def test_what_is_remembered_of_a_choice_is_what_it_has() -> None:
    for kind, name in NAMES:
        settings = chosen(kind, name)
        fresh = [key.name for key in schema.keys(type(settings), base=settings)]
        assert [key.name for key in of_choice(kind, name)] == fresh
    assert "policy.hidden" in known(commands.find("train").settings, {})
