"""Each job of a sweep as a job of a SLURM cluster, through submitit; its time over, it is queued again and goes on.

Before its time is over SLURM signals a job: a training takes a checkpoint, and the job is queued anew, its number kept.
Jobs belong to the cluster: whoever started the sweep may be killed, and the same command finds them where they are.
"""

import os
import signal
import subprocess
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from aerial_il.cli.sweeps.board import BAD_USAGE, Board
from aerial_il.cli.sweeps.job import GRACE_S, Job, start
from aerial_il.cli.sweeps.optional import require
from aerial_il.core.bounded import read_json
from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.core.files import write_json
from aerial_il.workflows.parts.names import at_least

FOLDER = ".slurm"  # of a job's own: what was submitted, under which number, and how it ended
SUBMITTED = "submitted.json"
POLL_S = 2.0
_STEP_S = 0.2
_EARLY_S = 60  # by so much SLURM's signal may come before its time
GONE_S = 20.0  # out of the queue for so long without having said how it ended: it died


@dataclass(frozen=True)
class Slurm:
    """What a job asks the cluster for.

    Attributes:
        hours: until it is queued again; training goes on from its checkpoint.
        requeues: how often at most.
        cores: for flights.
        memory_gb, gpus, partition, account: what is asked for; 0 or null for none.
        signal_s: how long before its time limit a job is signalled.
        threads: of torch and BLAS in each; results repeat bit for bit at a fixed number only.
        options: others of sbatch, {qos:long,constraint:a100}.
    """

    hours: float = 4.0
    requeues: int = 20
    cores: int = 1
    memory_gb: float = 0.0
    gpus: int = 0
    partition: str | None = None
    account: str | None = None
    signal_s: int = 120
    threads: int = 1
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        at_least(self, requeues=0, cores=1, gpus=0, signal_s=0, threads=1)
        if 3600 * self.hours < self.signal_s + _EARLY_S:
            raise InvalidValueError(
                f"hours={self.hours} is too short: a job is signalled signal_s={self.signal_s} seconds before its end, "
                f"and SLURM may do so {_EARLY_S} seconds early."
            )

    def launch(self, jobs: Sequence[Job], board: Board) -> None:
        require("submitit", extra="cluster")
        _asked("sinfo", "--noheader")  # a mistake shows before anything is submitted
        numbers = dict[Job, str]()
        try:
            for job in jobs:
                board.started(job)
                numbers[job] = _still_queued(job) or self._submit(job)
            self._await(numbers, board)
        except KeyboardInterrupt:
            subprocess.run(["scancel", *(n for job, n in numbers.items() if job not in board.outcomes)], check=False)
            raise

    def _submit(self, job: Job) -> str:
        """Queue ``job`` and return its number."""
        import submitit
        from submitit.core.utils import FailedJobError

        folder = Path(job.folder).resolve() / FOLDER
        executor = submitit.SlurmExecutor(folder=folder, max_num_timeout=self.requeues)
        executor.update_parameters(**self._parameters(job))
        try:
            number = executor.submit(Attempt(job, self.threads, self.cores)).job_id
        except FailedJobError as error:
            raise InvalidValueError(f"SLURM refused {job.name}: {error}") from error
        write_json(folder / SUBMITTED, {"job_id": number, "overrides": list(job.overrides)})
        return number

    def _parameters(self, job: Job) -> dict[str, Any]:
        asked: dict[str, Any] = {
            "job_name": job.name[:60],
            "time": max(1, round(60 * self.hours)),
            "cpus_per_task": self.cores,
            "signal_delay_s": self.signal_s,
            "additional_parameters": {**({"account": self.account} if self.account else {}), **self.options},
        }
        asked |= {"partition": self.partition} if self.partition else {}
        asked |= {"mem": f"{round(1024 * self.memory_gb)}M"} if self.memory_gb else {}
        return asked | ({"gpus_per_node": self.gpus} if self.gpus else {})

    def _await(self, numbers: Mapping[Job, str], board: Board) -> None:
        """Tell how each job ended, by what it wrote; one that left the queue without a word has died."""
        missing = dict[Job, float]()
        while waited := [job for job in numbers if job not in board.outcomes]:
            queued = _queue()
            for job in waited:
                if (status := _status(job, numbers[job])) is not None:
                    board.ended(job, status)
                elif numbers[job] in queued:
                    missing.pop(job, None)
                elif time.monotonic() - missing.setdefault(job, time.monotonic()) > GONE_S:
                    board.ended(job, 1, f"SLURM's job {numbers[job]} died: killed, cancelled, or its node failed")
            board.refresh()
            time.sleep(POLL_S)


class Attempt:
    """What runs on the cluster; submitit calls ``checkpoint`` when the job's time is over.

    It does so within a signal of the main thread, which therefore holds no lock: another thread waits for the process.
    """

    def __init__(self, job: Job, threads: int, cores: int) -> None:
        self.job, self.threads, self.cores = job, threads, cores
        self._process: subprocess.Popen[bytes] | None = None
        self._status: int | None = None

    def __call__(self) -> int:
        try:
            process = start(self.job, threads=self.threads, cores=self.cores)
        except AerialError:
            self._status = BAD_USAGE
        else:
            self._process = process
            threading.Thread(target=self._watch, args=[process], daemon=True).start()
        while self._status is None:
            time.sleep(_STEP_S)
        write_json(_end_of(self.job, os.environ["SLURM_JOB_ID"]), {"status": self._status})
        return self._status

    def checkpoint(self) -> Any:
        """Let the process take its checkpoint; what is returned is queued again."""
        from submitit.helpers import DelayedSubmission

        if self._process is not None and self._status is None:
            os.kill(self._process.pid, signal.SIGTERM)
            deadline = time.monotonic() + GRACE_S
            while self._status is None and time.monotonic() < deadline:
                time.sleep(_STEP_S)
            if self._status is None:
                os.killpg(self._process.pid, signal.SIGKILL)
        return DelayedSubmission(Attempt(self.job, self.threads, self.cores))

    def _watch(self, process: subprocess.Popen[bytes]) -> None:
        self._status = process.wait()


def _end_of(job: Job, number: str) -> Path:
    return Path(job.folder) / FOLDER / f"{number}_ended.json"


def _status(job: Job, number: str) -> int | None:
    """Return the exit status that a job of SLURM wrote down, None before."""
    try:
        return int(read_json(_end_of(job, number))["status"])
    except (OSError, ValueError, LookupError, TypeError):
        return None


def _still_queued(job: Job) -> str | None:
    """Return the number under which an earlier call queued this very job, if it still waits or runs."""
    try:
        note = read_json(Path(job.folder) / FOLDER / SUBMITTED)
        number, same = str(note["job_id"]), note["overrides"] == list(job.overrides)
    except (OSError, ValueError, LookupError, TypeError):
        return None
    return number if same and number in _queue() and _status(job, number) is None else None


def _queue() -> set[str]:
    """Return the numbers of this user's jobs that wait or run."""
    return set(_asked("squeue", "--me", "--noheader", "--format=%i").split())


def _asked(*words: str) -> str:
    """Return what a command of SLURM prints.

    Raises:
        InvalidValueError: there is no such command, or SLURM does not answer.
    """
    try:
        answer = subprocess.run(words, capture_output=True, text=True, check=False)
    except FileNotFoundError as error:
        hint = "Call it on a login node; to try it on this machine: make slurm"
        raise InvalidValueError(f"launcher=slurm needs SLURM's commands, and there is no {words[0]}. {hint}") from error
    if answer.returncode:
        goes_on = "Jobs that were submitted go on; the same command finds them."
        raise InvalidValueError(f"{words[0]} failed: {answer.stderr.strip()}. {goes_on}")
    return answer.stdout
