"""Run a command as it was typed: once, in parts, or as a sweep once for each combination of values."""

from __future__ import annotations

from collections.abc import Mapping

from aerial_il.cli.commands import Command
from aerial_il.cli.configuration.compose import compose, planned, run_once, swept
from aerial_il.cli.configuration.flags import sweeps
from aerial_il.cli.configuration.keys import output_key
from aerial_il.cli.configuration.overrides import prepare
from aerial_il.cli.configuration.quoting import command_line
from aerial_il.cli.launchers import Launcher
from aerial_il.cli.sweeps.job import Job
from aerial_il.cli.sweeps.sweep import SWEEPER, conclude, launcher_of, parted, run_sweep, sweeper_of
from aerial_il.core.errors import InvalidValueError


def run_command(command: Command, words: list[str]) -> None:
    """Run ``command`` with the flags and overrides in ``words``.

    Raises:
        AerialError: for every mistake in the words; whatever the command itself raises.
    """
    launched, rest = parted(words)
    searched, rest = parted(rest, SWEEPER)
    overrides, again = prepare(command, rest), command_line([command.name, *words])
    if searched:
        _search(command, rest, searched, again)
    elif sweeps(rest):
        launcher = launcher_of(launched)
        if jobs := [Job(command.name, said, folder) for said, folder in planned(command, overrides)]:
            run_sweep(jobs, launcher, again)
    elif launched:
        _run_divided(command, rest, launcher_of(launched), again)
    else:
        run_once(command, overrides)


def _run_divided(command: Command, words: list[str], launcher: Launcher, again: str) -> None:
    """Run a command in parts, each a job, and then once as a whole, which does what is left and comes to an end."""
    if command.shards is None:
        raise InvalidValueError(f"launcher= is for sweeps, and {command.name} is a single run: add -m to sweep.")
    overrides = prepare(command, words)
    parts = command.shards(compose(command, words))
    run_sweep([Job(command.name, (*overrides, *said), folder) for said, folder in parts], launcher, again)
    run_once(command, overrides)


def _search(command: Command, words: list[str], told: Mapping[str, str], again: str) -> None:
    """Let a sweeper choose the points, instead of trying every combination."""
    target = output_key(command.config)
    if not sweeps(words) or not target:
        raise InvalidValueError(f"{SWEEPER}= is for sweeps: add -m, to a command with an output.")
    sweeper, space, fixed = sweeper_of(told), *swept(command, words)
    folder = getattr(compose(command, [word for word in words if word.startswith(f"{target}=")]), target)
    conclude(sweeper.search(command.name, space, fixed, target, folder), again)
