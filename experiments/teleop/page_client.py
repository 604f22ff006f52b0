"""A client that speaks as the page does, without a browser: it sends inputs at 50 Hz and reads the answers."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from typing import Any
from urllib.parse import urlsplit, urlunsplit

import aiohttp

from aerial_il.core.errors import AerialError

PERIOD_S = 0.02


class SilentServerError(AerialError, TimeoutError):
    """A server that does not say what it should."""


class PageClient:
    """A page that somebody sits at.

    Attributes:
        held: names of controls that are down. status: what was status last. spoke: when it last said something, s.
    """

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._socket, self._seq = socket, 0
        self._pressed: list[str] = []
        self.held: list[str] = []
        self.status: dict[str, Any] = {}
        self.spoke = 0.0

    def press(self, control: str) -> None:
        """Press and release a control."""
        self._pressed.append(control)

    async def until(self, said: Callable[[dict[str, Any]], bool], timeout_s: float = 30.0) -> dict[str, Any]:
        """Return the first status of which ``said`` is true."""
        end = time.perf_counter() + timeout_s
        while not (self.status and said(self.status)):
            if time.perf_counter() > end:
                raise SilentServerError(f"The server's status is still {self.status}.")
            await asyncio.sleep(0.005)
        return self.status

    async def speak(self) -> None:
        """Say what is held, until cancelled."""
        with suppress(ConnectionError):
            while True:
                self._seq += 1
                pressed, self._pressed = self._pressed, []
                held = [*self.held, *pressed]
                message = {"type": "input", "seq": self._seq, "held": held, "pressed": pressed, "axes": {}, "t": 0.0}
                await self._socket.send_str(json.dumps(message))
                self.spoke = time.perf_counter()
                await asyncio.sleep(PERIOD_S)

    async def hear(self) -> None:
        """Keep the newest status, until the server is gone."""
        async for message in self._socket:
            if message.type is aiohttp.WSMsgType.TEXT and (status := json.loads(message.data))["type"] == "status":
                self.status = status


@asynccontextmanager
async def sitting(url: str) -> AsyncIterator[tuple[PageClient, asyncio.Task[None]]]:
    """Sit at the page of ``url``; yields the page, and what to cancel so that it falls silent."""
    parts = urlsplit(url)
    async with aiohttp.ClientSession() as session:
        socket = await session.ws_connect(urlunsplit(parts._replace(path="/socket")))
        page = PageClient(socket)
        speaking, hearing = asyncio.create_task(page.speak()), asyncio.create_task(page.hear())
        try:
            yield page, speaking
        finally:
            for task in (speaking, hearing):
                task.cancel()
                with suppress(asyncio.CancelledError):
                    await task
