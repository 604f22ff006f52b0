"""Each job of a sweep as a task of a Ray cluster: many machines that share a file system, or this one alone.

A task whose worker or machine dies is given to another one, and the job goes on there from its checkpoint.
"""

import logging
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from aerial_il.cli.sweeps.board import BAD_USAGE, Board
from aerial_il.cli.sweeps.job import Job, start, stop
from aerial_il.cli.sweeps.optional import require
from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.workflows.parts.names import at_least

POLL_S = 0.5
_OURS = {"RAY_USAGE_STATS_ENABLED": "0", "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0"}  # nothing is sent anywhere


@dataclass(frozen=True)
class Ray:
    """Which cluster, and what a job asks it for.

    Attributes:
        address: of a running cluster, e.g. auto or 10.0.0.1:6379; null starts one of this machine's cores.
        jobs: cores of the cluster that is started, 0 for this machine's.
        cores, gpus: for each job.
        retries: of a job whose worker or machine dies.
        threads: of torch and BLAS in each; results repeat bit for bit at a fixed number only.
    """

    address: str | None = None
    jobs: int = 0
    cores: int = 1
    gpus: float = 0.0
    retries: int = 3
    threads: int = 1

    def __post_init__(self) -> None:
        at_least(self, jobs=0, cores=1, gpus=0, retries=0, threads=1)

    def launch(self, jobs: Sequence[Job], board: Board) -> None:
        require("ray", extra="cluster")
        ray = self._connect()
        try:
            task = ray.remote(num_cpus=self.cores, num_gpus=self.gpus, max_retries=self.retries)(_run)
            here = os.getcwd()
            asked = {task.remote(job, here, self.threads, self.cores): job for job in jobs}
            for job in jobs:
                board.started(job)
            while asked:
                done, _ = ray.wait(list(asked), timeout=POLL_S)
                for one in done:
                    board.ended(asked.pop(one), *_result(ray, one))
                board.refresh()
        finally:
            ray.shutdown()

    def _connect(self) -> Any:
        os.environ |= _OURS
        import ray

        own = self.address is None
        said: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR, "configure_logging": False}
        said |= {"num_cpus": self.jobs or None, "include_dashboard": False} if own else {}
        try:
            ray.init("local" if own else self.address, **said)
        except (ConnectionError, ValueError, RuntimeError) as error:
            raise InvalidValueError(f"launcher.address={self.address}: no Ray cluster answers ({error}).") from error
        return ray


def _run(job: Job, folder: str, threads: int, cores: int) -> tuple[int, str]:
    """Run a job on whatever machine, in the ``folder`` in which the sweep was started; return how it ended."""
    os.chdir(folder)
    try:
        process = start(job, threads=threads, cores=cores)
    except AerialError as error:
        return BAD_USAGE, str(error)
    try:
        while process.poll() is None:
            time.sleep(POLL_S)
        return process.returncode, ""
    finally:
        stop([process])


def _result(ray: Any, task: Any) -> tuple[int, str]:
    try:
        return ray.get(task)
    except ray.exceptions.RayError as error:
        return 1, f"Ray gave it up: {str(error).strip().splitlines()[0]}"
