"""One job after the other, in the process that was called; what they say is shown as if they were called alone."""

import os
import sys
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from aerial_il.cli.sweeps.board import BAD_USAGE, Board
from aerial_il.cli.sweeps.job import Job, limits
from aerial_il.core.errors import AerialError
from aerial_il.workflows.parts.names import at_least


@dataclass(frozen=True)
class Serial:
    """No process is started.

    Attributes:
        threads: of torch and BLAS; results repeat bit for bit at a fixed number only.
    """

    threads: int = 1

    def __post_init__(self) -> None:
        at_least(self, threads=1)

    def launch(self, jobs: Sequence[Job], board: Board) -> None:
        with _limited(self.threads):
            for job in jobs:
                board.started(job)
                board.ended(job, *_outcome(job))


def _outcome(job: Job) -> tuple[int, str]:
    """Run a job; return its exit status and, where it failed, why."""
    from aerial_il.cli.compose import perform

    try:
        perform(job.command, job.overrides)
    except AerialError as error:
        return BAD_USAGE, str(error)
    except Exception as error:
        traceback.print_exc(file=sys.stderr)
        return 1, f"{type(error).__name__}: {error}"
    return 0, ""


@contextmanager
def _limited(threads: int) -> Iterator[None]:
    """Let libraries, those that are not imported yet too, compute in so many threads within the block."""
    before, torch = {name: os.environ.get(name) for name in limits(threads)}, sys.modules.get("torch")
    default = torch.get_num_threads() if torch else threads
    os.environ.update(limits(threads))
    if torch:
        torch.set_num_threads(threads)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})
        if torch:
            torch.set_num_threads(default)
