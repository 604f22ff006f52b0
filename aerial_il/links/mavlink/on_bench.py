"""A simulated robot behind the stand-in autopilot, in this process: its vehicle over MAVLink, its scene from the side.

What the vehicle shows of itself is the autopilot's estimate, over the wire; objects, the force at the wrist and what
has become of the task come from the simulator, as from a motion-capture system and from a referee.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from aerial_il.core.specs import EnvSpec
from aerial_il.links.link import Order
from aerial_il.links.mavlink.bench import Bench
from aerial_il.links.mavlink.client import OffboardClient
from aerial_il.links.mavlink.elsewhere import TOLD, AutopilotLink
from aerial_il.links.mavlink.telemetry import VehicleState
from aerial_il.suite.scenario import Scenario


class BenchLink(AutopilotLink):
    """The link to it.

    Args:
        robot, task, tier: of the scene. level: of the actions in its specification.
        place, lockstep, speed: see :class:`Bench`.
    """

    def __init__(
        self, robot: str, task: str, tier: str, *, level: str, place: str, lockstep: bool, speed: float
    ) -> None:
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

    def step(self) -> None:
        self._client.step()

    def close(self) -> None:
        self._client.close()
        self._bench.close()

    def _open(self, seed: int) -> None:
        """Set up the bench at the start of an episode, and connect to it."""
        self._bench = Bench(*self._cell, seed=seed, place=self._place, port=0, lockstep=self.lockstep, speed=self.speed)
        port = self._bench.port
        self._begin(self._cell[0], self._level, OffboardClient(self._cell[0], port=port, lockstep=self.lockstep))

    def _await_air(self) -> None:
        """Let time pass until rotors carry the vehicle."""
        while self._client.state.mode.value == "taking_off" or self._bench.world.held:
            self._client.step()

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
