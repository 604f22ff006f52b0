"""Worlds of an environment from outside shared among processes, for Python steps one of them at a time.

The process that asks flies the first share itself; the others wait for their turn in a process each. What a world does
depends on its seed and its actions alone, so that the number of processes changes nothing but the time.

Whoever asks decides when to stop: its processes ignore the signals that are sent to all of a group, and end when their
pipe is closed, whether by :meth:`SharedBatch.close`, at exit, or because the asker was killed.
"""

from __future__ import annotations

import multiprocessing
import pickle
import select
import signal
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields
from multiprocessing.connection import Connection
from multiprocessing.resource_tracker import ensure_running
from multiprocessing.util import Finalize
from typing import Any

import numpy as np

from aerial_il.core.contracts import BatchEnvBase, StepResult
from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.core.seeding import seeds_of
from aerial_il.suite.outside.batch import OutsideBatch
from aerial_il.suite.physics.thread_pool import available_cores

LEAST_WORLDS = 8  # in a process: fewer do not pay for its start and its messages
WATCH_S = 0.002  # that a process polls for commands before it sleeps
PATIENCE_S = 5.0  # for a process to end by itself
POLITE = (signal.SIGINT, signal.SIGTERM)  # answered by who asks: it saves, and closes the pipes
ENDED = (
    "A process that flies worlds has ended. In a script, what starts processes stands below "
    "`if __name__ == '__main__':`; in a notebook, what makes the environment comes from a module; or use processes=1."
)
NOT_PICKLED = (
    "What makes the environment cannot be pickled for another process: {}. Use a module's function, or processes=1."
)

MakeBatch = Callable[[int], OutsideBatch]


class SharedBatch(BatchEnvBase):
    """n worlds in several processes; what it answers is what one :class:`OutsideBatch` of n worlds would.

    An environment's own error arrives as a ``RuntimeError`` with its traceback where its world is in another process.

    Attributes:
        num_envs, spec, rule, model, model_xml, camera_names, ends_at_success, seeds: see :class:`OutsideBatch`.

    Args:
        make: ``worlds -> batch`` of that many; it is pickled. num_envs: worlds. processes: among which they are shared,
            this one included.

    Raises:
        InvalidValueError: fewer worlds than processes, ``make`` cannot be pickled, or a process has ended at its start.
    """

    def __init__(self, make: MakeBatch, num_envs: int, processes: int) -> None:
        if not 1 <= processes <= num_envs:
            raise InvalidValueError(f"processes must be from 1 to num_envs={num_envs}, got {processes}.")
        shares = [len(share) for share in np.array_split(np.arange(num_envs), processes)]
        self._bounds = np.cumsum(shares)[:-1]
        self._others = [_Elsewhere(make, share) for share in shares[1:]]
        self._own = make(shares[0])
        self.num_envs, self.ends_at_success = num_envs, self._own.ends_at_success
        self.spec, self.rule = self._own.spec, self._own.rule
        self.model, self.model_xml, self.goal_spec = self._own.model, self._own.model_xml, self._own.goal_spec
        self.seeds = self._all("seeds")

    def __repr__(self) -> str:
        return f"SharedBatch({self.spec.robot}:{self.spec.task}, {self.num_envs} worlds)"

    @property
    def ctrl(self) -> np.ndarray:
        """(n, nu) actuator controls, where the environment is MuJoCo's."""
        return self._all("ctrl")

    @property
    def sim_time(self) -> np.ndarray:
        """(n,) seconds since the start of each episode."""
        return self._all("sim_time")

    def reset(self, seeds: np.ndarray | int, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Start episodes in all worlds, or in those of ``mask``; see :meth:`OutsideBatch.reset`."""
        each = seeds_of(seeds, self.num_envs)
        self.seeds = each.copy() if mask is None else np.where(mask, each, self.seeds)
        return self._all("reset", each, mask)

    def step(self, actions: np.ndarray, mask: np.ndarray | None = None) -> StepResult:
        """Take one step with actions (n, Da); see :meth:`OutsideBatch.step`."""
        return self._all("step", np.asarray(actions, float), mask)

    def observe(self) -> dict[str, np.ndarray]:
        """Last observations of all worlds, ``name -> (n, ...)``."""
        return self._all("observe")

    def get_state(self) -> np.ndarray:
        """(n, S); see :meth:`OutsideBatch.get_state`."""
        return self._all("get_state")

    def set_state(self, states: np.ndarray, mask: np.ndarray | None = None) -> dict[str, np.ndarray]:
        """Continue from states (n, S); see :meth:`OutsideBatch.set_state`."""
        return self._all("set_state", states, mask)

    def close(self) -> None:
        """Close all environments and end the processes."""
        try:
            self._own.close()
        finally:
            for other in self._others:
                other.hang_up()
            for other in self._others:
                other.wait()

    def _all(self, name: str, *rows: np.ndarray | None) -> Any:
        """Ask every share for an attribute, or for what a method answers to its part of ``rows``; join the answers."""
        parts = [self._parts(values) for values in rows]
        shares = list(zip(*parts, strict=True)) if rows else [()] * (len(self._others) + 1)
        for other, share in zip(self._others, shares[1:], strict=True):
            other.ask(name, share)
        return joined([answer(self._own, name, shares[0]), *(other.answer() for other in self._others)])

    def _parts(self, values: np.ndarray | None) -> list[np.ndarray | None]:
        return [None] * (len(self._others) + 1) if values is None else [*np.split(values, self._bounds)]


class _Elsewhere:
    """A batch in a process of its own."""

    def __init__(self, make: MakeBatch, worlds: int) -> None:
        context = multiprocessing.get_context("spawn")  # a fork would inherit locks of torch's and MuJoCo's threads
        self._asked = 0
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=serve, args=(theirs, make, worlds), daemon=True)
        try:
            with deaf():
                self._process.start()
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise InvalidValueError(NOT_PICKLED.format(error)) from error
        theirs.close()
        self.hang_up = Finalize(self, self._pipe.close, exitpriority=1)  # at exit too, before processes are waited for

    def ask(self, name: str, rows: tuple[np.ndarray | None, ...]) -> None:
        self._asked += 1
        try:
            self._pipe.send((self._asked, name, rows))
        except OSError as error:
            raise InvalidValueError(ENDED) from error

    def answer(self) -> Any:
        """Return what was last asked for, or raise the error that it met."""
        try:
            while (answered := received(self._pipe))[0] != self._asked:
                pass  # the answer to a question whose asker was interrupted before it listened
        except (EOFError, OSError) as error:
            raise InvalidValueError(ENDED) from error
        if isinstance(found := answered[1], Exception):
            raise found
        return found

    def wait(self) -> None:
        """Wait until the process has ended; kill it where it does not."""
        self._process.join(PATIENCE_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


@contextmanager
def deaf() -> Iterator[None]:
    """Hold back polite signals, from a process that is started meanwhile too."""
    ensure_running()  # what it starts when it is first needed would let them through
    before = signal.pthread_sigmask(signal.SIG_BLOCK, POLITE)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def serve(pipe: Connection, make: MakeBatch, worlds: int) -> None:
    """Answer what is asked through ``pipe`` until its other end is closed: by its owner, or because that was killed."""
    for number in POLITE:
        signal.signal(number, signal.SIG_IGN)
    batch = attempt(make, worlds)
    try:
        while True:
            question, name, rows = received(pipe)
            pipe.send((question, batch if isinstance(batch, Exception) else attempt(answer, batch, name, rows)))
    except (EOFError, OSError):
        if not isinstance(batch, Exception):
            batch.close()


def received(pipe: Any) -> Any:
    """Return what is said next through a connection, watching it for a while: to be woken takes longer than to look."""
    watched = select.poll()
    watched.register(pipe, select.POLLIN)
    patience = time.perf_counter() + WATCH_S
    while not watched.poll(0) and time.perf_counter() < patience:
        pass
    return pipe.recv()


def answer(batch: OutsideBatch, name: str, rows: tuple[Any, ...]) -> Any:
    """Return an attribute of ``batch``, or what its method answers to ``rows``."""
    found = getattr(batch, name)
    return found(*rows) if callable(found) else found


def attempt(call: Callable[..., Any], *args: Any) -> Any:
    """Return what a call returns, or its error in a form that another process can be sent."""
    try:
        return call(*args)
    except AerialError as error:
        return error
    except Exception:
        return RuntimeError(traceback.format_exc())


def joined(answers: list[Any]) -> Any:
    """Return the answers of all shares as those of one batch: arrays one below the other, wherever they are kept."""
    first = answers[0]
    if isinstance(first, StepResult):
        return StepResult(*(joined([getattr(each, field.name) for each in answers]) for field in fields(first)))
    if isinstance(first, dict):
        return {name: joined([each[name] for each in answers]) for name in first}
    return np.concatenate(answers)


def processes_for(threads: int, num_envs: int) -> int:
    """Return among how many processes to share ``num_envs`` worlds; ``threads``: at most, 0 for all cores."""
    return max(1, min(threads or available_cores(), num_envs // LEAST_WORLDS))
