"""The page to fly on, for this machine alone and with a token: pictures go out, frames of devices come in."""

import asyncio
import json
import ssl
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict
from typing import Any

from aiohttp import WSCloseCode, WSMsgType, web

from aerial_il.core.errors import AerialError
from aerial_il.teleop.devices.phone import CLUTCH, Phone
from aerial_il.teleop.input.inbox import Inbox
from aerial_il.teleop.input.mapping import Bindings
from aerial_il.teleop.session.clock import Pace
from aerial_il.teleop.session.cockpit import Cockpit
from aerial_il.teleop.session.loop import Loop
from aerial_il.teleop.session.status import Status
from aerial_il.teleop.web.access import Access
from aerial_il.teleop.web.answers import ASSETS, document, packed, page_file, refusal
from aerial_il.teleop.web.controls import Controls
from aerial_il.teleop.web.film import Film, Shot
from aerial_il.teleop.web.guard import Guard
from aerial_il.teleop.web.messages import Message, MessageError, read_message
from aerial_il.teleop.web.visitors import Visitor, Visitors

STATUS_PERIOD_S = 0.05
CLOSING_BYTES = 1 << 20  # a message longer than this closes the connection
MAX_VISITORS = 16
MAX_DROPPED = 1000  # a page that has sent so many bad messages is closed


class PortTakenError(AerialError, OSError):
    """The page's port belongs to another program."""


class Server:
    """Serves the page of one flight.

    Args:
        inbox: where frames of the controller's devices go. about: what the page says of the flight, as plain values.
        host, port: where; port 0 for any that is free. tls: for a page over https.
        controls: mappings that may be changed on the page. summary: writes a page about the folder recorded into.
    """

    def __init__(
        self,
        inbox: Inbox,
        about: Mapping[str, Any],
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        tls: ssl.SSLContext | None = None,
        controls: Controls | None = None,
        summary: Callable[[], str] | None = None,
    ) -> None:
        self._inbox, self._about, self._host, self._port = inbox, dict(about), host, port
        self._access, self._tls, self._phone = Access(host, secure=tls is not None), tls, Phone()
        self._controls, self._summary = controls, summary
        self.visitors = Visitors()
        self.flight: Loop | None = None
        self.film: Film | None = None
        self.lesson: dict[str, Any] = {}  # how a policy that learns from the flights gets on
        self._latest: dict[str, Any] = {}
        self.shot: Shot | None = None  # the latest pictures
        self._events: asyncio.AbstractEventLoop | None = None
        self._runner: web.AppRunner | None = None
        self._guard: Guard | None = None

    @property
    def port(self) -> int:
        """Where it serves, once it has started."""
        return self._access.port

    @property
    def token(self) -> str:
        """Who knows it may come in."""
        return self._access.token

    @property
    def url(self) -> str:
        """Address of the page, with its token."""
        return self._access.url

    async def start(self) -> None:
        """Begin to serve.

        Raises:
            PortTakenError: another program listens there.
        """
        self._events = asyncio.get_running_loop()
        app = web.Application()
        app.router.add_get("/", self._index)
        app.router.add_get("/socket", self._socket)
        app.router.add_get("/summary", self._summarise)
        app.router.add_get("/{name}", self._asset)
        self._runner = runner = web.AppRunner(app, access_log=None, shutdown_timeout=1.0)
        await runner.setup()
        assert runner.server is not None
        self._guard = Guard(runner.server)
        site = web.TCPSite(runner, self._host, self._port, ssl_context=self._tls)
        try:
            await site.start()
        except OSError as error:
            await self.close()
            raise PortTakenError(
                f"port={self._port} on {self._host} is taken by another program. Choose another one, or port=0 for any."
            ) from error
        self._access.port = runner.addresses[0][1]

    async def close(self) -> None:
        """End it, and say good-bye to every page."""
        if self._guard is not None:
            self._guard.close()
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
        self.shot = shot
        if self._events is not None and not self._events.is_closed():
            self._events.call_soon_threadsafe(self._wake_all)

    def _wake_all(self) -> None:
        for visitor in self.visitors:
            visitor.fresh.set()

    async def _index(self, request: web.Request) -> web.Response:
        if not self._access.is_addressed(request):
            hint = f"Open the URL that the terminal shows; a tunnel must keep its port, {self.port}."
            return refusal(f"This address is not the page's own. {hint}")
        if not self._access.knows_token(request):
            return refusal("The token is missing or wrong. Open the whole URL that the terminal shows, token and all.")
        return page_file("index.html")

    async def _asset(self, request: web.Request) -> web.Response:
        name = request.match_info["name"]
        if name not in ASSETS or not self._access.is_addressed(request):
            return refusal("There is no such page.", status=404)
        return page_file(name, ASSETS[name])

    async def _summarise(self, request: web.Request) -> web.Response:
        if not self._access.is_addressed(request) or not self._access.knows_token(request):
            return refusal("The token is missing or wrong. Open the summary from the page that you fly on.")
        if self._summary is None:
            return refusal("This flight has no summary.", status=404)
        try:
            return document(await asyncio.to_thread(self._summary))
        except AerialError as error:
            return refusal(f"No summary: {error}", status=503)

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        access = self._access
        if not access.knows_token(request) or not access.is_addressed(request) or not access.is_own_origin(request):
            return refusal("The token is missing or wrong, or the page is another one.")
        if len(self.visitors) >= MAX_VISITORS:
            return refusal(f"{MAX_VISITORS} pages are open already; close one.", status=503)
        assert self._guard is not None
        self._guard.welcome.add(request.transport)
        socket = web.WebSocketResponse(max_msg_size=CLOSING_BYTES, heartbeat=5.0, compress=False)
        await socket.prepare(request)
        visitor = self.visitors.enter(socket)
        self._watch()
        senders = [asyncio.create_task(work(visitor)) for work in (self._send_pictures, self._send_status)]
        try:
            await self._greet(visitor)
            async for message in socket:
                if message.type is WSMsgType.TEXT:
                    await self._receive(visitor, message.data)
                else:
                    self.visitors.drop(visitor, "malformed")
                if visitor.dropped.total() > MAX_DROPPED:
                    await socket.close(code=WSCloseCode.POLICY_VIOLATION, message=b"Too many bad messages.")
        finally:
            for sender in senders:
                sender.cancel()
            self._guard.welcome.discard(request.transport)
            if self.visitors.leave(visitor):
                self._let_go()
            self._watch()
        return socket

    def _watch(self) -> None:
        if self.film is not None:
            self.film.watched = len(self.visitors) > 0

    async def _greet(self, visitor: Visitor) -> None:
        await visitor.socket.send_str(json.dumps({"type": "hello", **self._about, "number": visitor.number}))

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
            visitor.fresh.set()
        elif message.kind == "ask":
            if self.visitors.ask(visitor):
                self._release()
        elif message.kind == "grant":
            if self.visitors.grant(visitor):
                self._let_go()
        elif visitor is not self.visitors.controller:
            return
        elif message.kind == "bind":
            await self._bind(visitor, message)
        else:
            if message.held or message.pressed or any(message.axes.values()) or message.pose:
                visitor.touched_s = time.monotonic()
            self._take(message)

    def _take(self, message: Message) -> None:
        if message.kind in ("scrub", "practice", "view"):
            self._arrange(message)
            return
        if message.kind == "blur":
            self._release()
            return
        clutched, closed_now = CLUTCH in message.held, CLUTCH in message.pressed
        moved, anew = self._phone.move(message.pose, clutched=clutched, closed_now=closed_now)
        pressed = (*message.pressed, CLUTCH) if anew else message.pressed
        axes = message.axes | moved
        self._inbox.receive(seq=message.seq, held=message.held, pressed=pressed, axes=axes, t_client=message.t)

    async def _bind(self, visitor: Visitor, message: Message) -> None:
        """Change what keys and buttons mean, or say why not."""
        ok, text = False, "Keys cannot be changed in this flight."
        try:
            if self._latest.get("state") != "idle":
                text = "Finish this episode first: keys change between two."
            elif self._controls is not None and self.flight is not None:
                bindings = self._controls.change(message.mapping) if message.mapping else self._controls.reset()
                self.flight.do(lambda cockpit: self._rebind(cockpit, bindings))
                self._about["bindings"] = bindings.to_dict()
                for each in self.visitors:
                    await self._greet(each)
                ok, text = True, f"Saved in {self._controls.folder}." if message.mapping else "As shipped again."
        except (AerialError, OSError) as error:
            text = str(error)
        await visitor.socket.send_str(json.dumps({"type": "bound", "ok": ok, "text": text}))

    def _rebind(self, cockpit: Cockpit, bindings: Bindings) -> None:
        if cockpit.rebind(bindings):
            self._inbox.rebind(bindings)

    def _arrange(self, message: Message) -> None:
        """Do what changes what is shown or kept, and flies nothing."""
        if self.flight is None or self.film is None:
            return
        if message.kind == "scrub":
            self.flight.do(lambda cockpit: cockpit.look_back(message.share))
        elif message.kind == "practice":
            self.flight.do(lambda cockpit: cockpit.practise(on=message.on))
        else:
            main, side = self.film.cameras
            others = [name for name in self._about["views"] if name != main]
            self.film.cameras = (main, others[(others.index(side) + 1) % len(others)])

    def _release(self) -> None:
        self._phone.let_go()
        self._inbox.release()

    def _let_go(self) -> None:
        """Hover: nobody is at the controls."""
        self._release()
        if self.flight is not None:
            self.flight.leave()

    async def _send_pictures(self, visitor: Visitor) -> None:
        while True:
            await visitor.fresh.wait()
            visitor.fresh.clear()
            shot = self.shot
            if shot is not None and visitor.ready and shot.number > visitor.sent:
                visitor.expects(shot.number)
                await visitor.socket.send_bytes(packed(shot))

    async def _send_status(self, visitor: Visitor) -> None:
        while True:
            visitors = self.visitors
            if visitors.pass_on():
                self._let_go()
            around = {
                "role": visitors.role(visitor),
                "free": visitors.controller is None,
                "asked": visitors.asking.number if visitors.asking else 0,
                "visitors": len(visitors),
                "dropped": dict(visitors.dropped),
                "lesson": self.lesson,
                "cameras": self.film.cameras if self.film else self._about["cameras"],
            }
            if self._latest:
                await visitor.socket.send_str(json.dumps({"type": "status", **self._latest, **around}))
            await asyncio.sleep(STATUS_PERIOD_S)
