"""Settings of the link over ROS 2."""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from typing import TYPE_CHECKING

from aerial_il.core.checks import require_positive
from aerial_il.core.errors import InvalidValueError
from aerial_il.links.settings import LinkSettings

if TYPE_CHECKING:
    from aerial_il.links.link import Link
    from aerial_il.links.robot import SimulatedRobot

log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Ros2(LinkSettings):
    """A robot on ROS 2, simulated elsewhere or real.

    Attributes:
        namespace: of its topics and services.
        speed: of the time of the robot that aerial-il simulate serves: 2 is twice as fast.
        timeout_s: how long it may take to be there, and to answer an order.
    """

    namespace: str = "/aerial"
    speed: float = 1.0
    timeout_s: float = 10.0

    def __post_init__(self) -> None:
        require_positive(self, "speed", "timeout_s")

    def missing(self) -> str:
        from aerial_il.links.ros2.middleware import ros

        try:
            ros()
        except InvalidValueError as error:
            return str(error)
        return ""

    def connect(self, here: Callable[[], SimulatedRobot], *, level: str | None = None) -> Link:
        from aerial_il.links.ros2.ros2_link import Ros2Link

        return Ros2Link(self.namespace, level=level, timeout_s=self.timeout_s)

    def serve(self, robot: SimulatedRobot) -> None:
        from aerial_il.links.ros2.robot_node import RobotNode

        with closing(RobotNode(robot, namespace=self.namespace, speed=self.speed)) as node:
            log.info("%s is on %s, until Ctrl-C.", robot.spec.robot, self.namespace)
            node.run()
