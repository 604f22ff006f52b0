"""A simulated robot behind the stand-in autopilot, in this process: its vehicle over MAVLink, its scene from the side.

What the vehicle shows of itself is the autopilot's estimate, over the wire; objects, the force at the wrist and what
has become of the task come from the simulator, as from a motion-capture system and from a referee. Latency is that
between this side and the companion computer aboard, which does whole-body control.
"""

from collections import deque
from typing import Any

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.specs import EnvSpec
from aerial_il.links.link import Mode, Order, Reading
from aerial_il.links.mavlink.bench import Bench
from aerial_il.links.mavlink.client import OffboardClient
from aerial_il.links.mavlink.elsewhere import TOLD, AutopilotLink
from aerial_il.links.mavlink.telemetry import VehicleState
from aerial_il.suite.scenario import Scenario


class BenchLink(AutopilotLink):
    """The link to it.

    Args:
        robot, task, tier: of the scene. level: of the actions in its specification.
        place, lockstep, speed: see :class:`Bench`. late: ticks that readings and set points are late by, in lockstep.

    Raises:
        InvalidValueError: time does not wait, and something is to be late.
    """

    def __init__(
        self,
        robot: str,
        task: str,
        tier: str,
        *,
        level: str,
        place: str,
        lockstep: bool,
        speed: float,
        late: tuple[int, int] = (0, 0),
    ) -> None:
        if any(late) and not lockstep:
            raise InvalidValueError("Latency over MAVLink is for link.lockstep=true: there it is a number of ticks.")
        self._late = late
        self._cell, self._level, self.lockstep, self.speed = (robot, task, tier), level, lockstep, speed
        self._place = place
        self.spec: EnvSpec = Scenario(robot, task, tier, level).spec
        self._open(0)

    def order(self, order: Order, **numbers: float) -> None:
        if order is Order.RESET:
            self.close()
            self._open(int(numbers.get("seed", 0)))
            return
        super().order(order, **numbers)
        if order is Order.TAKE_OFF and self.lockstep:
            self._await_air()

    def read(self) -> Reading | None:
        newest = super().read()
        return self._seen[0] if self._late[0] and self._seen else newest

    def send(self, level: str, action: np.ndarray) -> None:
        if not self._late[1]:
            super().send(level, action)
        self._newest = level, action

    def step(self) -> None:
        """Let 20 ms pass, in lockstep."""
        if self._late[1]:
            self._sent.append(self._newest)
            if (arrived := self._sent.popleft()) is not None:
                super().send(*arrived)
            self._newest = None
        self._client.step()
        self._seen.append(self._reading(self._client.state))

    def close(self) -> None:
        self._client.close()
        self._bench.close()

    def _open(self, seed: int) -> None:
        """Set up the bench at the start of an episode, and connect to it."""
        self._bench = Bench(*self._cell, seed=seed, place=self._place, port=0, lockstep=self.lockstep, speed=self.speed)
        self._newest: tuple[str, np.ndarray] | None = None
        self._sent: deque[tuple[str, np.ndarray] | None] = deque([None] * self._late[1])
        self._seen: deque[Reading] = deque(maxlen=self._late[0] + 1)
        port = self._bench.port
        self._begin(self._cell[0], self._level, OffboardClient(self._cell[0], port=port, lockstep=self.lockstep))

    def _await_air(self) -> None:
        """Let time pass until rotors carry the vehicle."""
        while self._client.state.mode is Mode.TAKING_OFF or self._bench.world.held:
            self._client.step()
        self._seen.extend([self._reading(self._client.state)] * (self._late[0] + 1))

    def _own(self, state: VehicleState) -> dict[str, np.ndarray]:
        seen = {name: value[0] for name, value in self._bench.world.env.observe().items() if name not in TOLD}
        own = {**super()._own(state), **seen}
        return {name: own[name] for name in self.spec.observation.names}

    def _told(self) -> dict[str, Any]:
        world = self._bench.world
        verdict = world.assessment
        return {
            "success": world.solved,
            "crash": world.crashed,
            "dropped": bool(verdict.dropped[0]),
            "subtasks": verdict.subtasks[0],
            "reward": float(verdict.reward[0]),
            "seed": int(world.env.seeds[0]),
        }
