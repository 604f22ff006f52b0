"""Progress of a sweep's jobs while they run: bars on a terminal, lines in a log, and a table at the end."""

import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

from aerial_il.cli.sweeps.job import Job
from aerial_il.cli.tables import table
from aerial_il.core.progress import Progress, is_terminal

BAD_USAGE = 2
_LINES_EVERY_S, _BARS_EVERY_S = 30.0, 0.5
_SHOWN = 100  # letters of what a job said last, or of why it failed


@dataclass(frozen=True)
class Outcome:
    """How a job ended: its exit status, negative for a signal, the time it took, and why it failed."""

    job: Job
    status: int
    seconds: float
    reason: str = ""

    @property
    def state(self) -> str:
        return "finished" if self.status == 0 else "failed"


class Board:
    """Told by a launcher what starts and ends.

    Args:
        jobs: all of them; what they say goes to logs of theirs, and is shown here by its last line.
    """

    def __init__(self, jobs: Sequence[Job]) -> None:
        self.jobs, self.outcomes = tuple(jobs), dict[Job, Outcome]()
        self._started: dict[Job, float] = {}
        self._bars: dict[Job, Progress] = {}
        self._drawn, self._refreshed = is_terminal(sys.stderr), time.monotonic()
        self._bar = Progress(total=len(jobs), desc="sweep", unit="job", disable=not self._drawn)

    def started(self, job: Job) -> None:
        """``job`` is running now."""
        self._started[job] = time.monotonic()
        if self._drawn:
            self._bars[job] = Progress(desc=job.name, bar_format="  {desc}", leave=False)
        else:
            self._say(f"{job.name}: started.")

    def ended(self, job: Job, status: int, reason: str = "") -> None:
        """``job`` has ended with the exit ``status``; ``reason`` says why where its log does not."""
        seconds = time.monotonic() - self._started.get(job, time.monotonic())
        why = "" if status == 0 else reason or _by_signal(status) or job.complaint()
        self.outcomes[job] = outcome = Outcome(job, status, seconds, why)
        if bar := self._bars.pop(job, None):
            bar.close()
        self._bar.update()
        if not self._drawn:
            state = outcome.state + (f" ({why[:_SHOWN]})" if why else "")
            self._say(f"{job.name}: {state}, after {seconds:.0f} s; {len(self.outcomes)} of {len(self.jobs)}.")

    def refresh(self) -> None:
        """Tell what the running jobs said last, if it is time to."""
        if time.monotonic() - self._refreshed < (_BARS_EVERY_S if self._drawn else _LINES_EVERY_S):
            return
        self._refreshed = time.monotonic()
        for job in self._started.keys() - self.outcomes.keys():
            line = f"{job.name}: {job.last_line()[:_SHOWN]}"
            if job in self._bars:
                self._bars[job].set_description_str(line)
            elif not self._drawn:
                self._say(line)

    def close(self) -> None:
        for bar in (*self._bars.values(), self._bar):
            bar.close()

    @property
    def failed(self) -> list[Outcome]:
        """What did not work, in the order of the jobs."""
        return [self.outcomes[job] for job in self.jobs if job in self.outcomes and self.outcomes[job].status]

    @property
    def status(self) -> int:
        """The exit status of the sweep: 0, 2 if only mistakes in what was asked for stopped jobs, else 1."""
        statuses = {outcome.status for outcome in self.failed}
        return 0 if not statuses else BAD_USAGE if statuses == {BAD_USAGE} else 1

    def table(self) -> str:
        """Return one line for each job."""
        ended = [self.outcomes.get(job) for job in self.jobs]
        return table(
            [
                {
                    "job": job.name,
                    "state": outcome.state if outcome else "not run",
                    "seconds": round(outcome.seconds) if outcome else 0,
                    "why": outcome.reason[:_SHOWN] if outcome else "",
                }
                for job, outcome in zip(self.jobs, ended, strict=True)
            ]
        )

    def _say(self, line: str) -> None:
        print(line, file=sys.stderr, flush=True)


def _by_signal(status: int) -> str:
    """Return by what a job was killed, empty if it ended by itself."""
    number = -status if status < 0 else 0
    names = {each.value: each.name for each in signal.Signals}
    hint = "; out of memory?" if number == signal.SIGKILL else ""
    return f"killed by {names.get(number, number)}{hint}" if number else ""
