"""Settings of links, which import nothing heavy: each kind has a folder, whose ``link.py`` holds its own."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from aerial_il.core.errors import InvalidValueError

if TYPE_CHECKING:
    from aerial_il.links.link import Link
    from aerial_il.links.robot import SimulatedRobot


class LinkSettings:
    """Settings of one kind of link: frozen dataclasses in ``links/NAME/link.py`` inherit from it."""

    def connect(self, here: Callable[[], SimulatedRobot], *, level: str | None = None) -> Link:
        """Return a link to a robot that is there already, or to the one that is made by ``here``.

        Args:
            here: makes a robot in this process. level: of the actions in its specification; None for the robot's own.

        Raises:
            LinkError: there is none, or it does not answer. InvalidValueError: packages are missing; names the command.
        """
        raise NotImplementedError

    def serve(self, robot: SimulatedRobot) -> None:
        """Let others fly a simulated robot over such a link, until interrupted."""
        raise InvalidValueError(f"link={self.name} is flown in one process: aerial-il fly link={self.name} ...")

    def missing(self) -> str:
        """Return what must be installed first, and how; nothing if all is there."""
        return ""

    @property
    def name(self) -> str:
        """What it is called: the name of its folder."""
        return type(self).__module__.split(".")[-2]
