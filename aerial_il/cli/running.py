"""Run a command as it was typed: once, in parts, or as a sweep once for each combination of values."""

from __future__ import annotations

from collections.abc import Mapping

from aerial_il.cli import words
from aerial_il.cli.commands import Command
from aerial_il.cli.compose import output_folder, points, settings_of, space
from aerial_il.cli.launchers import Launcher
from aerial_il.cli.sweeps.job import Job
from aerial_il.cli.sweeps.sweep import LAUNCHER, SWEEPER, chosen_of, conclude, parted, run_sweep
from aerial_il.core.errors import InvalidValueError
from aerial_il.workflows.spelling import command_line


def run_command(command: Command, typed: list[str]) -> None:
    """Run ``command`` with the flags and words that were typed.

    Raises:
        AerialError: for every mistake in the words; whatever the command itself raises.
    """
    launched, rest = parted(typed, LAUNCHER)
    searched, rest = parted(rest, SWEEPER)
    read, again = words.read(command, rest), command_line([command.name, *typed])
    if searched:
        _search(command, read, searched, again)
    elif read.shows:
        print(_shown(command, read))
    elif read.sweeps:
        launcher = chosen_of(LAUNCHER, launched)
        run_sweep(
            [Job(command.name, said, folder) for said, folder in points(command, read.overrides)], launcher, again
        )
    elif launched:
        _run_divided(command, read, chosen_of(LAUNCHER, launched), again)
    else:
        command.run(settings_of(command, read.overrides))


def _shown(command: Command, read: words.Typed) -> str:
    """Return the settings that words lead to, as YAML; of a sweep, what was said."""
    import yaml

    from aerial_il.core.composition import plain

    if read.sweeps:
        return "\n".join(" ".join(said) for said, _ in points(command, read.overrides))
    return yaml.safe_dump(plain(_whole(command, read)), sort_keys=False, allow_unicode=True).rstrip()


def _whole(command: Command, read: words.Typed) -> object:
    """Return settings in which every choice is made, those by default too."""
    from dataclasses import replace

    from aerial_il.core.composition import chosen, keys

    settings = settings_of(command, read.overrides)
    choices = {key.name: key.kind for key in keys(command.settings) if key.takes == "choice"}
    return replace(settings, **{name: chosen(kind, getattr(settings, name)) for name, kind in choices.items()})


def _run_divided(command: Command, read: words.Typed, launcher: Launcher, again: str) -> None:
    """Run a command in parts, each a job, and then once as a whole, which does what is left and comes to an end."""
    if command.shards is None:
        raise InvalidValueError(f"launcher= is for sweeps, and {command.name} is a single run: add -m to sweep.")
    settings = settings_of(command, read.overrides)
    jobs = [Job(command.name, (*read.overrides, *more), folder) for more, folder in command.shards(settings)]
    run_sweep(jobs, launcher, again)
    command.run(settings)


def _search(command: Command, read: words.Typed, chosen: Mapping[str, str], again: str) -> None:
    """Let a sweeper choose the points, instead of trying every combination."""
    if not read.sweeps or not command.output:
        raise InvalidValueError(f"{SWEEPER}= is for sweeps: add -m, to a command with an output.")
    sweeper, (ways, fixed) = chosen_of(SWEEPER, chosen), space(command, read.overrides)
    folder = output_folder(command, read.overrides)
    conclude(sweeper.search(command.name, ways, fixed, command.output, folder), again)
