"""A simulator and a stand-in autopilot on threads of their own, joined by real sockets, for a client to fly."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from aerial_il import robots
from aerial_il.links.mavlink.autopilot import Autopilot
from aerial_il.links.mavlink.client import OffboardClient
from aerial_il.links.mavlink.sensors import Sensors
from aerial_il.links.mavlink.simulator import Simulator
from aerial_il.links.mavlink.wire import HungUpError
from aerial_il.links.mavlink.world import CradledWorld


class Bench:
    """Both ends, and the client between whose steps time stands still."""

    def __init__(self, robot: str, *, tier: str = "calm", gps: str = "rtk", seed: int = 0, **simulator: bool) -> None:
        self.world = CradledWorld(robot, "reach", tier, seed=seed)
        self.simulator = Simulator(self.world, Sensors(gps, seed=seed), port=0, **simulator)
        there = ("127.0.0.1", self.simulator.port)
        self.autopilot = Autopilot(
            robots.get(robot).vehicle, simulator=there, client=("127.0.0.1", 0), lockstep=True, patience_s=120.0
        )
        self.errors: list[BaseException] = []
        self._threads = [
            threading.Thread(target=self._run, args=(each.run,)) for each in (self.simulator, self.autopilot)
        ]
        for thread in self._threads:
            thread.start()
        self.client = OffboardClient(robot, port=self.autopilot.port, lockstep=True, patience_s=120.0)

    def close(self) -> None:
        self.client.close()
        for thread in self._threads:
            thread.join()
        self.simulator.close()

    def _run(self, run: Callable[[], None]) -> None:
        try:
            run()
        except BaseException as error:
            self.errors.append(error)


@contextmanager
def flown(robot: str = "ua_quad_arm4", **settings: object) -> Iterator[Bench]:
    """A bench whose client is connected; what goes wrong on its threads is raised at the end."""
    bench = Bench(robot, **settings)  # type: ignore[arg-type]
    try:
        bench.client.connect()
        yield bench
    finally:
        with suppress(HungUpError):
            bench.close()
    if bench.errors:
        raise bench.errors[0]
