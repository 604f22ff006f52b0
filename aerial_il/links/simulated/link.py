"""Settings of the link to a robot of the suite in this process."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from aerial_il.core.checks import require_choice, require_positive, require_share
from aerial_il.links.settings import LinkSettings

if TYPE_CHECKING:
    from aerial_il.links.link import Link
    from aerial_il.links.robot import SimulatedRobot

Clock = Literal["lockstep", "wall"]


@dataclass(frozen=True, kw_only=True)
class Simulated(LinkSettings):
    """A robot of the suite, simulated here.

    Attributes:
        clock: lockstep (its time waits for the policy, as in an evaluation) or wall (it does not).
        speed: of its time, with clock=wall: 2 is twice as fast.
        loss: share of set points and of readings that are lost on the way, from 0 to 1.
    """

    clock: Clock = "lockstep"
    speed: float = 1.0
    loss: float = 0.0

    def __post_init__(self) -> None:
        require_choice(self, "clock", Clock)
        require_positive(self, "speed")
        require_share(self, "loss", below_one=True)

    def connect(self, here: Callable[[], SimulatedRobot], *, level: str | None = None) -> Link:
        from aerial_il.links.simulated.in_process import SimulatedLink

        return SimulatedLink(here(), lockstep=self.clock == "lockstep", speed=self.speed, loss=self.loss)
