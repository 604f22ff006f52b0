"""The page to fly on, for this machine alone and with a token: pictures go out, frames of devices come in."""

from __future__ import annotations

import asyncio
import hmac
import json
import secrets
import struct
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from aiohttp import WSMsgType, web

from aerial_il.core.errors import AerialError
from aerial_il.teleop.clock import Pace
from aerial_il.teleop.cockpit import Status
from aerial_il.teleop.film import Film, Shot
from aerial_il.teleop.inbox import Inbox
from aerial_il.teleop.loop import Loop
from aerial_il.teleop.messages import Message, MessageError, read_message
from aerial_il.teleop.visitors import Visitor, Visitors

PAGE = Path(__file__).parent / "page"
MEDIA_TYPES = {".css": "text/css", ".js": "text/javascript"}
ASSETS = {file.name: MEDIA_TYPES[file.suffix] for file in PAGE.iterdir() if file.suffix in MEDIA_TYPES}
LOOPBACK = ("127.0.0.1", "localhost", "::1")
STATUS_PERIOD_S = 0.05
CLOSING_BYTES = 1 << 20  # a message longer than this closes the connection
POLICY = "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; connect-src 'self'"


class PortTakenError(AerialError, OSError):
    """The page's port belongs to another program."""


class Server:
    """Serves the page of one flight.

    Args:
        inbox: where frames of the controller's devices go. about: what the page says of the flight, as plain values.
        host, port: where; port 0 for any that is free. token: who knows it may come in.
    """

    def __init__(
        self,
        inbox: Inbox,
        about: Mapping[str, Any],
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        token: str | None = None,
    ) -> None:
        self._inbox, self._about, self._host, self._port = inbox, dict(about), host, port
        self.token = token or secrets.token_urlsafe(16)
        self.visitors = Visitors()
        self.flight: Loop | None = None
        self.film: Film | None = None
        self._latest: dict[str, Any] = {}
        self._shot: Shot | None = None
        self._fresh: dict[Visitor, asyncio.Event] = {}
        self._events: asyncio.AbstractEventLoop | None = None
        self._runner: web.AppRunner | None = None

    @property
    def port(self) -> int:
        """Where it listens."""
        return self._port

    @property
    def url(self) -> str:
        """Address of the page, with its token."""
        return f"http://{self._host}:{self._port}/?token={self.token}"

    async def start(self) -> None:
        """Begin to serve.

        Raises:
            PortTakenError: another program listens there.
        """
        self._events = asyncio.get_running_loop()
        app = web.Application()
        app.router.add_get("/", self._index)
        app.router.add_get("/socket", self._socket)
        app.router.add_get("/{name}", self._asset)
        self._runner = runner = web.AppRunner(app, access_log=None, shutdown_timeout=1.0)
        await runner.setup()
        site = web.TCPSite(runner, self._host, self._port)
        try:
            await site.start()
        except OSError as error:
            await runner.cleanup()
            raise PortTakenError(
                f"port={self._port} on {self._host} is taken by another program. Choose another one, or port=0 for any."
            ) from error
        self._port = runner.addresses[0][1]

    async def close(self) -> None:
        """End it, and say good-bye to every page."""
        for visitor in self.visitors:
            with suppress(ConnectionError):
                await visitor.socket.close(message=b"The flight has ended.")
        if self._runner is not None:
            await self._runner.cleanup()

    def report(self, status: Status, pace: Pace) -> None:
        """Take note of what is to be shown; from any thread."""
        self._latest = {**asdict(status), "pace": asdict(pace)}

    def deliver(self, shot: Shot) -> None:
        """Take note of new pictures; from any thread."""
        self._shot = shot
        if self._events is not None and not self._events.is_closed():
            self._events.call_soon_threadsafe(self._wake_all)

    def _wake_all(self) -> None:
        for event in self._fresh.values():
            event.set()

    async def _index(self, request: web.Request) -> web.Response:
        if not self._is_local(request):
            return _refusal("This address is not the page's own. Open the URL that the terminal shows.")
        if not self._knows_token(request):
            return _refusal("The token is missing or wrong. Open the whole URL that the terminal shows, token and all.")
        return _file("index.html", "text/html")

    async def _asset(self, request: web.Request) -> web.Response:
        name = request.match_info["name"]
        if name not in ASSETS or not self._is_local(request):
            return web.Response(status=404, text="There is no such page.")
        return _file(name, ASSETS[name])

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        if not self._knows_token(request) or not self._is_local(request) or not self._is_own_origin(request):
            return _refusal("The token is missing or wrong, or the page is another one.")
        socket = web.WebSocketResponse(max_msg_size=CLOSING_BYTES, heartbeat=5.0, compress=False)
        await socket.prepare(request)
        visitor = self.visitors.enter(socket)
        self._fresh[visitor] = asyncio.Event()
        senders = [asyncio.create_task(work(visitor)) for work in (self._send_pictures, self._send_status)]
        try:
            await socket.send_str(json.dumps({"type": "hello", **self._about, "number": visitor.number}))
            async for message in socket:
                if message.type is WSMsgType.TEXT:
                    await self._receive(visitor, message.data)
                else:
                    self.visitors.drop(visitor, "malformed")
        finally:
            for sender in senders:
                sender.cancel()
            self._fresh.pop(visitor, None)
            if self.visitors.leave(visitor):
                self._let_go()
        return socket

    async def _receive(self, visitor: Visitor, text: str) -> None:
        """Do what a message asks for, if it is to be believed."""
        if not visitor.bucket.admits():
            self.visitors.drop(visitor, "flooding")
            return
        try:
            message = read_message(text)
        except MessageError as error:
            self.visitors.drop(visitor, str(error))
            return
        if message.kind == "ping":
            await visitor.socket.send_str(json.dumps({"type": "pong", "t": message.t, "now": time.perf_counter()}))
        elif message.kind == "ack":
            visitor.saw(message.seq)
            if self.film is not None and visitor is self.visitors.controller:
                self.film.thrift = visitor.link.thrift
            self._fresh[visitor].set()
        elif message.kind == "ask":
            if self.visitors.ask(visitor):
                self._inbox.release()
        elif message.kind == "grant":
            if self.visitors.grant(visitor):
                self._let_go()
        elif visitor is self.visitors.controller:
            self._take(message)

    def _take(self, message: Message) -> None:
        if message.kind == "blur":
            self._inbox.release()
            return
        self._inbox.receive(
            seq=message.seq, held=message.held, pressed=message.pressed, axes=message.axes, t_client=message.t
        )

    def _let_go(self) -> None:
        """Hover: nobody is at the controls."""
        self._inbox.release()
        if self.flight is not None:
            self.flight.leave()

    async def _send_pictures(self, visitor: Visitor) -> None:
        fresh = self._fresh[visitor]
        while True:
            await fresh.wait()
            fresh.clear()
            shot = self._shot
            if shot is not None and visitor.ready and shot.number > visitor.sent:
                visitor.expects(shot.number)
                await visitor.socket.send_bytes(packed(shot))

    async def _send_status(self, visitor: Visitor) -> None:
        while True:
            visitors = self.visitors
            around = {
                "role": visitors.role(visitor),
                "free": visitors.controller is None,
                "asked": visitors.asking.number if visitors.asking else 0,
                "visitors": len(visitors),
                "dropped": dict(visitors.dropped),
            }
            if self._latest:
                await visitor.socket.send_str(json.dumps({"type": "status", **self._latest, **around}))
            await asyncio.sleep(STATUS_PERIOD_S)

    def _knows_token(self, request: web.Request) -> bool:
        return hmac.compare_digest(request.query.get("token", "").encode(), self.token.encode())

    def _is_local(self, request: web.Request) -> bool:
        """Whether the browser asked for this machine by its own name: a stranger's name may be made to point here."""
        host = urlsplit(f"//{request.host}").hostname
        return self._host not in LOOPBACK or host in LOOPBACK

    def _is_own_origin(self, request: web.Request) -> bool:
        """Whether a page of this very address asks; programs that are no browsers send no origin."""
        origin = request.headers.get("Origin")
        return origin is None or urlsplit(origin).netloc == request.host


def packed(shot: Shot) -> bytes:
    """Return a shot as bytes: number, last message, time (s), number of images, their sizes, the images."""
    sizes = [len(image) for image in shot.images]
    head = struct.pack(f"<IIdI{len(sizes)}I", shot.number, shot.input_seq, shot.taken, len(sizes), *sizes)
    return head + b"".join(shot.images)


def _file(name: str, media_type: str) -> web.Response:
    headers = {"Content-Security-Policy": POLICY, "Referrer-Policy": "no-referrer", "Cache-Control": "no-store"}
    text = (PAGE / name).read_text(encoding="utf-8")
    return web.Response(text=text, content_type=media_type, charset="utf-8", headers=headers)


def _refusal(problem: str) -> web.Response:
    return web.Response(status=403, text=problem)
