"""A robot of the suite in this process: in lockstep with who flies it, or in real time on a thread of its own."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import numpy as np

from aerial_il.core.specs import EnvSpec
from aerial_il.links.link import Order, Reading
from aerial_il.teleop.session.clock import Metronome

if TYPE_CHECKING:
    from aerial_il.links.robot import SimulatedRobot


class SimulatedLink:
    """The link itself.

    Args:
        robot: what is flown; the link's own from now on.
        lockstep: whether its time waits for :meth:`step`. speed: of its time, where it does not.
        loss: share of set points and of readings that are lost.
    """

    def __init__(self, robot: SimulatedRobot, *, lockstep: bool = True, speed: float = 1.0, loss: float = 0.0) -> None:
        self.robot, self.lockstep, self.speed = robot, lockstep, speed
        self._loss, self._rng = loss, np.random.default_rng(0)
        self._lock, self._ended = threading.Lock(), threading.Event()
        self._newest = robot.reading()
        self._error: BaseException | None = None
        self._thread = None if self.lockstep else threading.Thread(target=self._run, name="robot", daemon=True)
        if self._thread:
            self._thread.start()

    @property
    def spec(self) -> EnvSpec:
        return self.robot.spec

    def read(self) -> Reading | None:
        if self._error is not None:
            raise self._error
        return self._newest

    def send(self, level: str, action: np.ndarray) -> None:
        if self._arrives():
            with self._lock:
                self.robot.command(level, action)

    def order(self, order: Order, **numbers: float) -> None:
        with self._lock:
            self.robot.order(order, **numbers)
            self._newest = self.robot.reading()
            if order is Order.RESET:
                self._rng = np.random.default_rng(int(numbers.get("seed", 0)))

    def step(self) -> None:
        """Let 20 ms pass; for others, only in lockstep."""
        with self._lock:
            self.robot.tick()
            if self._arrives():
                self._newest = self.robot.reading()

    def close(self) -> None:
        self._ended.set()
        if self._thread:
            self._thread.join()
        self.robot.close()

    def _arrives(self) -> bool:
        return not self._loss or self._rng.random() >= self._loss

    def _run(self) -> None:
        metronome = Metronome(self.spec.control_dt_s / self.speed)
        try:
            while not self._ended.is_set():
                metronome.wait()
                self.step()
        except BaseException as error:  # whoever reads hears of it
            self._error = error
