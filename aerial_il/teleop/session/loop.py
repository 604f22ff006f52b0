"""The flight in real time: a thread that ticks a cockpit fifty times a second and shows what comes of it."""

import threading
from collections import deque
from collections.abc import Callable

import mujoco
import numpy as np

from aerial_il.core.contracts import Device
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.physics.physics_batch import STATE
from aerial_il.teleop.input.frame import DeviceFrame
from aerial_il.teleop.session.clock import Metronome, Pace
from aerial_il.teleop.session.cockpit import Cockpit
from aerial_il.teleop.session.status import Status


class Loop:
    """Ticks a cockpit on a thread of its own.

    Args:
        cockpit: what is flown. device: what it is flown by. show: gets a copy of each state (S,) to be rendered and
            the number of the message that it answers. report: gets the status and the pace after each tick.
    """

    def __init__(
        self,
        cockpit: Cockpit,
        device: Device[DeviceFrame],
        show: Callable[[np.ndarray, int], None],
        report: Callable[[Status, Pace], None],
    ) -> None:
        self._cockpit, self._device, self._show, self._report = cockpit, device, show, report
        self._thread = threading.Thread(target=self._run, name="flight", daemon=True)
        self._ended, self._left = threading.Event(), threading.Event()
        self._news: deque[str] = deque(maxlen=8)
        self._work: deque[Callable[[Cockpit], None]] = deque(maxlen=64)
        self.error: BaseException | None = None

    def start(self) -> None:
        """Begin to fly."""
        self._thread.start()

    def leave(self, why: str = "") -> None:
        """Tell that nobody is at the controls, or that a device is gone: what is recorded pauses."""
        self._left.set()
        self.tell(why)

    def tell(self, news: str) -> None:
        """Show the person something at the next tick; from any thread."""
        if news:
            self._news.append(news)

    def do(self, work: Callable[[Cockpit], None]) -> None:
        """Let something be done to the cockpit on the flight's own thread, before the next tick; from any thread."""
        self._work.append(work)

    def close(self) -> None:
        """End the flight; what is finished is kept."""
        self._ended.set()
        if self._thread.ident is not None:
            self._thread.join()

    def _run(self) -> None:
        cockpit = self._cockpit
        metronome = Metronome(cockpit.env.spec.control_dt_s / cockpit.time_scale)
        try:
            while not self._ended.is_set():
                metronome.wait()
                if self._left.is_set():
                    self._left.clear()
                    cockpit.leave()
                while self._news:
                    cockpit.message = self._news.popleft()
                while self._work:
                    self._work.popleft()(cockpit)
                cockpit.tick(self._device.frame())
                looked_at = cockpit.looked_at
                self._show(state_of(cockpit.env) if looked_at is None else looked_at, cockpit.input_seq)
                self._report(cockpit.status(), metronome.pace)
        except BaseException as error:
            self.error = error
            raise
        finally:
            self._end()

    def _end(self) -> None:
        try:
            self._cockpit.close()
        except BaseException as error:
            self.error = self.error or error
            raise


def state_of(env: BatchEnvironment) -> np.ndarray:
    """Return a copy (S,) of what there is to be rendered of world 0."""
    worlds, state = env.simulation.worlds, np.empty(env.spec.state_size)
    mujoco.mj_getState(worlds.model, worlds.data(0), state, STATE)
    return state
