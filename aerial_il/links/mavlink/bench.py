"""A simulated robot behind the stand-in autopilot, both on threads of this process and joined by real sockets."""

import threading
from collections.abc import Callable

from aerial_il import robots
from aerial_il.links.mavlink.autopilot import Autopilot
from aerial_il.links.mavlink.protocol import CLIENT_PORT
from aerial_il.links.mavlink.sensors import Sensors
from aerial_il.links.mavlink.simulator import Simulator
from aerial_il.links.mavlink.world import CradledWorld


class Bench:
    """What an offboard client flies where there is no vehicle.

    Args:
        robot, task, tier, seed: of the episode. place: what tells the position, see :class:`Sensors`.
        port: for the client, see :class:`Autopilot`. simulator_port: between the two; 0 for a free one.
        lockstep: time waits for the client. speed: of time against the wall's, where it does not. boot: see
            :class:`Simulator`.

    Attributes:
        world, simulator, autopilot: what runs. error: what went wrong on its threads.

    Raises:
        LinkError: a port is in use.
    """

    def __init__(
        self,
        robot: str = "ua_quad_arm4",
        task: str = "reach",
        tier: str = "calm",
        *,
        seed: int = 0,
        place: str = "rtk",
        port: int = CLIENT_PORT,
        simulator_port: int = 0,
        lockstep: bool = False,
        speed: float = 1.0,
        boot: bool = False,
    ) -> None:
        self.world = CradledWorld(robot, task, tier, seed=seed)
        pace = 0.0 if lockstep else speed
        self.simulator = Simulator(
            self.world, Sensors(place, seed=seed), port=simulator_port, speed=pace, boot=boot, truth=True
        )
        there, client = ("127.0.0.1", self.simulator.port), ("127.0.0.1", port)
        self.autopilot = Autopilot(robots.get(robot).vehicle, simulator=there, client=client, lockstep=lockstep)
        self._closing = False
        self.error: BaseException | None = None
        self._threads = [
            threading.Thread(target=self._guard, args=(end.run,), name=type(end).__name__, daemon=True)
            for end in (self.simulator, self.autopilot)
        ]
        for thread in self._threads:
            thread.start()

    @property
    def port(self) -> int:
        """The client's."""
        return self.autopilot.port

    def close(self) -> None:
        """End both.

        Raises:
            BaseException: what went wrong on their threads.
        """
        self._closing = True
        self.autopilot.hang_up()
        self.simulator.hang_up()
        for thread in self._threads:
            thread.join()
        if self.error is not None:
            raise self.error

    def _guard(self, run: Callable[[], None]) -> None:
        try:
            run()
        except BaseException as error:  # whoever closes the bench hears of it
            self.error = self.error or (None if self._closing else error)
        finally:
            if run == self.simulator.run:
                self.simulator.close()
