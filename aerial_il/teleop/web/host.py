"""The page with all that serves it, on threads of its own, while something else flies."""

import asyncio
import threading
from collections.abc import Callable, Mapping
from typing import Any, Self

import mujoco

from aerial_il.teleop.input.inbox import Inbox
from aerial_il.teleop.input.mapping import Bindings
from aerial_il.teleop.web.film import Film
from aerial_il.teleop.web.server import Server


class PageHost:
    """Serves the page as long as the ``with`` block lasts.

    Args:
        model: what is filmed. cameras, size: see :class:`Film`. bindings: of the page's devices.
        texts: what the page says of the flight. place: keywords of :class:`Server`.
        opened: called when the page is there.

    Attributes:
        inbox: what the person does. server: of the page. film: shows them what flies.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        bindings: Bindings,
        texts: Mapping[str, Any],
        *,
        cameras: tuple[str, ...],
        size: tuple[int, int],
        opened: Callable[[Server], object],
        **place: Any,
    ) -> None:
        self.inbox, self._opened = Inbox(bindings), opened
        self.server = Server(self.inbox, texts, **place)
        self.film = Film(model, cameras, size, self.server.deliver)
        self.server.film, self.film.watched = self.film, False
        self._events = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._events.run_forever, name="page", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        try:
            asyncio.run_coroutine_threadsafe(self.server.start(), self._events).result()
        except BaseException:
            self._end_events()
            raise
        self.film.start()
        self._opened(self.server)
        return self

    def __exit__(self, *_: object) -> None:
        self.film.close()
        asyncio.run_coroutine_threadsafe(self.server.close(), self._events).result()
        self._end_events()

    def _end_events(self) -> None:
        self._events.call_soon_threadsafe(self._events.stop)
        self._thread.join()
        self._events.close()
