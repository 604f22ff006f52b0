"""Run a command as it was typed: once, in parts, or as a sweep once for each combination of values."""

from dataclasses import replace

from aerial_il.cli import words
from aerial_il.cli.commands import Command
from aerial_il.cli.compose import output_folder, points, settings_of, space
from aerial_il.cli.sweeps.job import Job
from aerial_il.cli.sweeps.sweep import chosen_of, conclude, run_sweep
from aerial_il.cli.words import LAUNCHER, SWEEPER, Typed
from aerial_il.core.composition import chosen, plain
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.schema import keys
from aerial_il.workflows.spelling import command_line


def run_command(command: Command, typed: list[str]) -> None:
    """Run ``command`` with the flags and words that were typed.

    Raises:
        AerialError: for every mistake in the words; whatever the command itself raises.
    """
    read = words.read(command, typed)
    if read.apart[SWEEPER]:
        _search(command, read, command_line([command.name, *typed]))
    elif read.shows:
        print(_shown(command, read))
    elif read.sweeps or read.apart[LAUNCHER]:
        _launch(command, read, command_line([command.name, *typed]))
    else:
        command.run(settings_of(command, read.overrides, read.earlier))


def _shown(command: Command, read: Typed) -> str:
    """Return the settings that words lead to, as YAML, every choice made; of a sweep the words of each point."""
    import yaml

    if read.sweeps:
        return "\n".join(" ".join(said) for said, _ in points(command, read.overrides))
    settings = settings_of(command, read.overrides, read.earlier)
    choices = {key.name: key.kind for key in keys(command.settings) if key.takes == "choice"}
    whole = {name: chosen(kind, getattr(settings, name)) for name, kind in choices.items()}
    return yaml.safe_dump(plain(replace(settings, **whole)), sort_keys=False, allow_unicode=True).rstrip()


def _launch(command: Command, read: Typed, again: str) -> None:
    """Run a sweep; or a command in parts, each a job, and then once as a whole, which does what is left and ends."""
    launcher = chosen_of(LAUNCHER, read.apart[LAUNCHER])
    if read.sweeps:
        jobs = [Job(command.name, said, folder) for said, folder in points(command, read.overrides)]
        run_sweep(jobs, launcher, again)
        if command.together is not None:
            command.together([job.folder for job in jobs])
        return
    if command.shards is None:
        raise InvalidValueError(f"launcher= is for sweeps, and {command.name} is a single run: add -m to sweep.")
    settings = settings_of(command, read.overrides, read.earlier)
    shards = [Job(command.name, (*read.overrides, *more), folder) for more, folder in command.shards(settings)]
    run_sweep(shards, launcher, again)
    command.run(settings)


def _search(command: Command, read: Typed, again: str) -> None:
    """Let a sweeper choose the points, instead of trying every combination."""
    if not read.sweeps or not command.output:
        raise InvalidValueError(f"{SWEEPER}= is for sweeps: add -m, to a command with an output.")
    sweeper, (ways, fixed) = chosen_of(SWEEPER, read.apart[SWEEPER]), space(command, read.overrides)
    folder = output_folder(command, read.overrides)
    conclude(sweeper.search(command.name, ways, fixed, command.output, folder), again)
