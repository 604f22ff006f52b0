"""Closes connections that have shown no token in time, and the oldest of them where there are too many."""

import asyncio
import time

from aiohttp import web
from aiohttp.web_protocol import RequestHandler

PERIOD_S = 1.0
IDLE_S = 10.0  # a connection that has shown no token for so long is closed
MAX_CONNECTIONS = 64  # open ones, those of unknown callers too


class Guard:
    """Watches the connections of one server.

    Args:
        server: whose they are.

    Attributes:
        welcome: transports that have shown the token.
    """

    def __init__(self, server: web.Server) -> None:
        self._server = server
        self.welcome: set[asyncio.BaseTransport | None] = set()
        self._task = asyncio.create_task(self._watch())

    def close(self) -> None:
        """End the watch."""
        self._task.cancel()

    async def _watch(self) -> None:
        since: dict[RequestHandler, float] = {}
        while True:
            await asyncio.sleep(PERIOD_S)
            now, connections = time.monotonic(), self._server.connections
            since = {c: since.get(c, now) for c in connections if c.transport not in self.welcome}
            oldest = sorted(since, key=since.__getitem__)
            surplus = max(0, len(connections) - MAX_CONNECTIONS)
            for connection in (c for i, c in enumerate(oldest) if i < surplus or now - since[c] > IDLE_S):
                connection.force_close()
