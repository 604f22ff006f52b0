"""Settings of the link over MAVLink."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from aerial_il.core.checks import require_choice, require_positive
from aerial_il.core.errors import InvalidValueError
from aerial_il.links.settings import LinkSettings

if TYPE_CHECKING:
    from aerial_il.links.link import Link
    from aerial_il.links.robot import SimulatedRobot

log = logging.getLogger(__name__)
Place = Literal["mocap", "rtk", "standard"]
WATCH_S = 0.2


@dataclass(frozen=True, kw_only=True)
class Mavlink(LinkSettings):
    """A robot behind an autopilot that speaks MAVLink: a simulated one behind the stand-in of ours, or one elsewhere.

    Attributes:
        robot: whose autopilot sends to this machine (null: a robot that is simulated here, behind the stand-in).
        port: for its datagrams.
        lockstep: time waits for the policy; only of a robot that is simulated here.
        place: what tells a simulated robot its position: mocap, rtk or standard, a GPS without corrections.
        speed: of its time, where that does not wait.
        patience_s: with an autopilot that says nothing.
    """

    robot: str | None = None
    port: int = 14540
    lockstep: bool = True
    place: Place = "mocap"
    speed: float = 1.0
    patience_s: float = 60.0

    def __post_init__(self) -> None:
        require_choice(self, "place", Place)
        require_positive(self, "speed", "patience_s")
        if not 0 <= self.port <= 65_535:
            raise InvalidValueError(f"port is {self.port}; it must lie in [0, 65535].")

    def connect(self, here: Callable[[], SimulatedRobot], *, level: str | None = None) -> Link:
        from aerial_il.links.mavlink.elsewhere import AutopilotLink
        from aerial_il.links.mavlink.on_bench import BenchLink
        from aerial_il.links.mavlink.wire import dialect

        dialect()
        if self.robot is not None:
            return AutopilotLink(self.robot, port=self.port, level=level or "base_joint", patience_s=self.patience_s)
        with closing(here()) as made:
            spec, late = made.spec, made.late
        own = {"place": self.place, "lockstep": self.lockstep, "speed": self.speed, "late": late}
        return BenchLink(spec.robot, spec.task, spec.tier, level=level or spec.action.level, **own)

    def serve(self, robot: SimulatedRobot) -> None:
        from aerial_il.links.mavlink.bench import Bench

        spec, seed = robot.spec, int(robot.env.seeds[0])
        own = {"place": self.place, "port": self.port, "speed": self.speed}
        with closing(Bench(spec.robot, spec.task, spec.tier, seed=seed, **own)) as bench:
            log.info("%s sends to UDP port %d, until Ctrl-C.", spec.robot, bench.port)
            while bench.error is None:
                time.sleep(WATCH_S)

    def missing(self) -> str:
        from aerial_il.links.mavlink.wire import dialect

        try:
            dialect()
        except InvalidValueError as error:
            return str(error)
        return ""
