"""Several jobs at a time on this machine, each a process with a log of its own in its folder.

A job that is killed is reported as failed and the others go on, which a pool of workers that hand results back, such as
joblib's, could not do. The machine's cores are divided among those that run.
"""

import subprocess
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from aerial_il.cli.sweeps.board import BAD_USAGE, Board
from aerial_il.cli.sweeps.job import Job, start, stop
from aerial_il.core.errors import AerialError
from aerial_il.suite.physics.thread_pool import available_cores
from aerial_il.workflows.parts.names import at_least

POLL_S = 0.1


@dataclass(frozen=True)
class Processes:
    """How many run at a time.

    Attributes:
        jobs: at a time; 0 for as many as there are cores.
        threads: of torch and BLAS in each; results repeat bit for bit at a fixed number only.
        retries: of a job that was killed, which then goes on where it was.
    """

    jobs: int = 0
    threads: int = 1
    retries: int = 1

    def __post_init__(self) -> None:
        at_least(self, jobs=0, threads=1, retries=0)

    def launch(self, jobs: Sequence[Job], board: Board) -> None:
        abreast = min(len(jobs), self.jobs or max(1, available_cores() // self.threads))
        cores = max(1, available_cores() // abreast)
        waiting, running = deque(jobs), dict[Job, subprocess.Popen[bytes]]()
        left = dict.fromkeys(jobs, self.retries)
        try:
            while waiting or running:
                while waiting and len(running) < abreast:
                    self._start(waiting.popleft(), running, board, cores)
                for job, process in list(running.items()):
                    if (status := process.poll()) is not None:
                        del running[job]
                        if status < 0 < left[job]:
                            left[job] -= 1
                            waiting.appendleft(job)
                        else:
                            board.ended(job, status)
                board.refresh()
                time.sleep(POLL_S)
        finally:
            stop(running.values())

    def _start(self, job: Job, running: dict[Job, subprocess.Popen[bytes]], board: Board, cores: int) -> None:
        board.started(job)
        try:
            running[job] = start(job, threads=self.threads, cores=cores)
        except AerialError as error:
            board.ended(job, BAD_USAGE, str(error))
