"""Visitors of the page: one has the controls, the others watch; control passes only on request."""

import asyncio
import time
from collections import Counter
from dataclasses import dataclass, field
from itertools import count

from aiohttp import web

from aerial_il.teleop.web.link import Link
from aerial_il.teleop.web.messages import Bucket

FORGOTTEN_S = 30.0  # a page with the controls that nobody touched for so long hands them over when asked
MAX_UNSEEN = 2  # pictures on their way to a page; more would only grow older


@dataclass(eq=False)
class Visitor:
    """One open page.

    Attributes:
        number: which one. socket: its connection. sent: number of the last picture sent. on_way: those that it has not
            shown yet. bucket: how many messages it may send. dropped: those that were not believed, by reason.
        link: how wide its link is. fresh: set when there may be a picture to send. touched_s: when a control was last
            held or moved on it.
    """

    number: int
    socket: web.WebSocketResponse
    on_way: list[int] = field(default_factory=list)
    sent: int = 0
    bucket: Bucket = field(default_factory=Bucket)
    dropped: Counter[str] = field(default_factory=Counter)
    link: Link = field(default_factory=Link)
    touched_s: float = field(default_factory=time.monotonic)
    fresh: asyncio.Event = field(default_factory=asyncio.Event)

    @property
    def ready(self) -> bool:
        """Whether another picture may be sent."""
        return len(self.on_way) < MAX_UNSEEN

    def expects(self, number: int) -> None:
        """Note that picture ``number`` is on its way to it."""
        self.sent = number
        self.on_way.append(number)
        self.link.send(number)

    def saw(self, number: int) -> None:
        """Note that it has shown picture ``number``, and so all before it."""
        self.link.arrive(number)
        self.on_way = [sent for sent in self.on_way if sent > number]


class Visitors:
    """All open pages."""

    def __init__(self) -> None:
        self._all: list[Visitor] = []
        self._numbers = count(1)
        self.controller: Visitor | None = None
        self.asking: Visitor | None = None
        self.dropped: Counter[str] = Counter()

    def __iter__(self):
        return iter(list(self._all))

    def __len__(self) -> int:
        return len(self._all)

    def enter(self, socket: web.WebSocketResponse) -> Visitor:
        """Let a page in; it gets the controls if nobody has them."""
        visitor = Visitor(next(self._numbers), socket)
        self._all.append(visitor)
        self.controller = self.controller or visitor
        return visitor

    def leave(self, visitor: Visitor) -> bool:
        """Let a page go; return whether it had the controls, which nobody has then."""
        self._all.remove(visitor)
        if self.asking is visitor:
            self.asking = None
        if self.controller is not visitor:
            return False
        self.controller = None
        return True

    def ask(self, visitor: Visitor) -> bool:
        """Ask for the controls; return whether they changed hands, as they do at once if nobody has them."""
        if self.controller is None:
            self.controller = visitor
            return True
        if visitor is not self.controller:
            self.asking = visitor
        return False

    def pass_on(self) -> bool:
        """Hand the controls of a forgotten page to who asks; return whether they changed hands."""
        page = self.controller
        return page is not None and time.monotonic() - page.touched_s > FORGOTTEN_S and self.grant(page)

    def grant(self, visitor: Visitor) -> bool:
        """Hand the controls to who asks; return whether they changed hands: only who has them may."""
        if visitor is not self.controller or self.asking is None:
            return False
        self.controller, self.asking = self.asking, None
        return True

    def role(self, visitor: Visitor) -> str:
        return "controller" if visitor is self.controller else "spectator"

    def drop(self, visitor: Visitor, reason: str) -> None:
        """Count a message that was not believed."""
        visitor.dropped[reason] += 1
        self.dropped[reason] += 1
