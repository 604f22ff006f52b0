"""Threads that write what others produce, so that nobody waits for a disk."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

WRITERS = 4  # more than cores: most of the time they wait for the disk


class WriterThreads:
    """Runs the jobs of each lane one after the other, those of different lanes at the same time.

    After a job has failed, no other of its lane is run: what follows a gap cannot be written.
    """

    def __init__(self) -> None:
        self._threads = [ThreadPoolExecutor(1, thread_name_prefix="writer") for _ in range(WRITERS)]
        self._failed: dict[int, BaseException] = {}

    def submit[T](self, lane: int, job: Callable[..., T], *arguments: Any, **options: Any) -> Future[T]:
        """Have ``job`` done after the earlier ones of its lane."""
        return self._threads[lane % WRITERS].submit(self._run, lane, job, arguments, options)

    def check(self) -> None:
        """Raise what the first job that failed has raised."""
        if self._failed:
            raise next(iter(self._failed.values()))

    def close(self) -> None:
        """Wait until all that was submitted is done."""
        for thread in self._threads:
            thread.shutdown()

    def _run(self, lane: int, job: Callable[..., Any], arguments: tuple, options: dict[str, Any]) -> Any:
        if lane in self._failed:
            raise self._failed[lane]
        try:
            return job(*arguments, **options)
        except BaseException as error:
            self._failed[lane] = error
            raise
