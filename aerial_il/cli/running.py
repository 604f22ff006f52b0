"""Run a command as it was typed: once, or as a sweep once for each combination of values."""

from __future__ import annotations

from aerial_il.cli.commands import Command
from aerial_il.cli.configuration.compose import planned, run_once
from aerial_il.cli.configuration.overrides import prepare, sweeps
from aerial_il.cli.configuration.quoting import command_line
from aerial_il.cli.sweeps.job import Job
from aerial_il.cli.sweeps.sweep import launcher_of, parted, run_sweep
from aerial_il.core.errors import InvalidValueError


def run_command(command: Command, words: list[str]) -> None:
    """Run ``command`` with the flags and overrides in ``words``.

    Raises:
        AerialError: for every mistake in the words; whatever the command itself raises.
    """
    launched, rest = parted(words)
    overrides = prepare(command, rest)
    if not sweeps(rest):
        if launched:
            raise InvalidValueError(f"{next(iter(launched))}= says how the jobs of a sweep run: add -m to sweep.")
        run_once(command, overrides)
        return
    launcher = launcher_of(launched)
    jobs = [Job(command.name, said, folder) for said, folder in planned(command, overrides)]
    if jobs:
        run_sweep(jobs, launcher, command_line([command.name, *words]))
