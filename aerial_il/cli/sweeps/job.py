"""One job of a sweep: a command line of its own, run in a process of its own, which writes a log into its folder."""

import fcntl
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import open_own
from aerial_il.core.places import JOB_LOG as LOG
from aerial_il.suite.physics.thread_pool import CORES

ENTRY = "_job"  # the word by which the console script knows that it is one
LIMITS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")  # of the libraries that compute in threads
PATIENCE_S = 60.0  # how long the job of a killed sweep may take to end, before its folder is called busy
GRACE_S = 30.0  # from being asked to end, which writes a checkpoint, to being killed
_TAIL_BYTES = 4000
BEGINS = b"\n--- begins ---\n"  # in a log, before what each attempt says
_ROOT = str(Path(__file__).resolve().parents[3])
_CODE = f"import sys; sys.path.append({_ROOT!r}); from aerial_il.cli.main import main; sys.exit(main())"


@dataclass(frozen=True)
class Job:
    """What one job of a sweep does.

    Attributes:
        command: e.g. ``train``. overrides: its words as Hydra reads them, the folder's among them.
        folder: its own, for results and log.
    """

    command: str
    overrides: tuple[str, ...]
    folder: str

    @property
    def name(self) -> str:
        return Path(self.folder).name

    @property
    def log(self) -> Path:
        return Path(self.folder) / LOG

    def last_line(self) -> str:
        """Return what it said last."""
        lines = self._tail()
        return lines[-1] if lines else ""

    def complaint(self) -> str:
        """Return the error that it ended with, as far as its log tells."""
        lines = self._tail()
        errors = [line.removeprefix("aerial-il: ") for line in lines if line.startswith("aerial-il: ")]
        return (errors or lines or [""])[-1]

    def _tail(self) -> list[str]:
        try:
            with open(self.log, "rb") as file:
                file.seek(max(0, file.seek(0, os.SEEK_END) - _TAIL_BYTES))
                text = file.read().rpartition(BEGINS)[2].decode(errors="replace")
        except OSError:
            return []
        return [line.strip() for line in text.replace("\r", "\n").splitlines() if line.strip()]


def start(job: Job, *, threads: int, cores: int) -> subprocess.Popen[bytes]:
    """Start a job's process; it ends by itself when this one dies.

    Args:
        job: what it does. threads: of torch and BLAS, on which results may depend. cores: for its flights.

    Raises:
        InvalidValueError: another process does this very job, and does not end soon; or its folder cannot be written.
    """
    words = [sys.executable, "-P", "-c", _CODE, ENTRY, job.command, *job.overrides]
    with _own_log(job) as log:
        unheard = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGUSR2})  # SLURM tells every process of a job
        try:
            return subprocess.Popen(
                words,
                stdin=subprocess.PIPE,  # never written to: its end says that this process is gone
                stdout=log,
                stderr=subprocess.STDOUT,
                env={**os.environ, **limits(threads), CORES: str(cores)},
                start_new_session=True,
            )
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, unheard)


def stop(processes: Iterable[subprocess.Popen[bytes]]) -> None:
    """Ask processes to end, which lets a training take a checkpoint; kill what has not ended after a while."""
    asked, deadline = list(processes), time.monotonic() + GRACE_S
    for process in asked:
        process.terminate()
    for process in asked:
        try:
            process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def limits(threads: int) -> Mapping[str, str]:
    """Return the environment in which libraries compute in so many threads."""
    return dict.fromkeys(LIMITS, str(threads))


def end_with_parent() -> None:
    """In a job's process: end it when the process that started it is gone, killed ones included."""
    threading.Thread(target=_wait_for_parent, name="aerial_il-parent", daemon=True).start()


def _wait_for_parent() -> None:
    while os.read(0, 1):  # not by sys.stdin, whose lock an ending interpreter would wait for
        pass
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(GRACE_S)
    os._exit(128 + signal.SIGTERM)


def _own_log(job: Job) -> BinaryIO:
    """Open the job's log, locked for as long as a process writes to it: no two do the same job."""
    try:
        Path(job.folder).mkdir(parents=True, exist_ok=True)
        log = open_own(job.log)
    except OSError as error:
        raise InvalidValueError(f"{job.folder[:200]} cannot be written: {error.strerror}.") from error
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            fcntl.flock(log, fcntl.LOCK_EX | fcntl.LOCK_NB)
            log.write(BEGINS)
            log.flush()
            return log
        except BlockingIOError as error:
            if time.monotonic() > deadline:
                log.close()
                raise InvalidValueError(f"{job.folder} is being worked on by another process.") from error
            time.sleep(0.1)
