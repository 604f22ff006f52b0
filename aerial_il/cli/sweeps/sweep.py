"""Run the jobs of a sweep by the launcher that was chosen, and say what became of each."""

import sys
from collections.abc import Mapping, Sequence
from typing import Any

import yaml

from aerial_il.cli.launchers import Launcher
from aerial_il.cli.sweeps.board import Board, Outcome
from aerial_il.cli.sweeps.job import Job
from aerial_il.core.composition import chosen
from aerial_il.core.errors import AerialError, InvalidValueError

DEFAULTS = {"launcher": "serial", "sweeper": "optuna"}
_REASONS = 3  # named in an error; the table has all


class JobsFailedError(AerialError):
    """Some jobs of a sweep failed; the others did their work.

    Args:
        message: which, and why. status: of the console script.
    """

    def __init__(self, message: str, status: int) -> None:
        super().__init__(message)
        self.status = status


def chosen_of(kind: str, words: Mapping[str, str]) -> Any:
    """Build the launcher or the sweeper that words chose.

    Raises:
        UnknownNameError: there is none of that name, or it has no such key.
        InvalidValueError: a value of another type, or beyond its limits.
    """
    name = words.get(kind, DEFAULTS[kind])
    inner = {key.partition(".")[2]: _value(key, value) for key, value in words.items() if key != kind}
    return chosen(kind, {"name": name, **inner}, at=f"{kind}.")


def run_sweep(jobs: Sequence[Job], launcher: Launcher, again: str) -> None:
    """Run ``jobs`` and print what became of them.

    Args:
        jobs: at least one. launcher: how. again: the command line that continues.

    Raises:
        JobsFailedError: not all of them did their work.
    """
    board = Board(jobs)
    try:
        launcher.launch(jobs, board)
    except (KeyboardInterrupt, SystemExit):
        board.close()
        print(f"Stopped with {len(board.outcomes)} of {len(jobs)} jobs done. Continue: {again}", file=sys.stderr)
        raise
    conclude(board, again)


def conclude(board: Board, again: str) -> None:
    """Print the table of jobs that have ended, and say which failed; arguments and errors as of :func:`run_sweep`."""
    board.close()
    print(board.table())
    if board.failed:
        raise JobsFailedError(f"{_summary(board.failed, len(board.jobs))} Again: {again}", board.status)


def _summary(failed: Sequence[Outcome], count: int) -> str:
    """Return which jobs failed, each reason once, and where the first one's words are."""
    reasons: dict[str, list[str]] = {}
    for outcome in failed:
        reasons.setdefault(outcome.reason, []).append(outcome.job.name)
    why = " ".join(f"{', '.join(names)}: {reason}" for reason, names in list(reasons.items())[:_REASONS])
    log = failed[0].job.log
    return f"{len(failed)} of {count} jobs failed. {why}" + (f" See {log}." if log.exists() else "")


def _value(key: str, text: str) -> Any:
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise InvalidValueError(f"{key}={text} cannot be read as a value.") from error
