"""MAVLink 2 messages over TCP and UDP sockets; pymavlink packs and parses them."""

import math
import os
import select
import socket
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from importlib import import_module
from typing import Any

from aerial_il.core.errors import InvalidValueError
from aerial_il.links.link import LinkError

BYTES = 65_536
PATIENCE_S = 60.0  # for the other end, which may have to compile first


class HungUpError(LinkError):
    """The other end has closed the connection."""


class NoAnswerError(LinkError):
    """The other end may speak, but what is waited for has not come."""


@cache
def dialect() -> Any:
    """pymavlink's module of the common messages.

    Raises:
        InvalidValueError: it is not installed.
    """
    os.environ.setdefault("MAVLINK20", "1")
    try:
        return import_module("pymavlink.dialects.v20.common")
    except ImportError as error:
        raise InvalidValueError(
            "MAVLink needs pymavlink, which is not installed: make setup-links in a checkout, or "
            "pip install 'aerial_il[mavlink]'"
        ) from error


class Wire:
    """One end of a MAVLink connection.

    Args:
        connection: a connected TCP socket, or a UDP socket, which answers whoever spoke last. system, component: ids.
        peer: what the other end is called in errors. patience_s: how long to wait for it.
    """

    def __init__(
        self, connection: socket.socket, system: int, component: int, peer: str, patience_s: float = PATIENCE_S
    ) -> None:
        self._socket, self.peer, self.patience_s = connection, peer, patience_s
        self._mav = dialect().MAVLink(None, srcSystem=system, srcComponent=component)
        self._mav.robust_parsing = True
        self._inbox: deque[Any] = deque()
        self._stream = connection.type == socket.SOCK_STREAM
        self._address: Any = None
        if self._stream:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    @property
    def heard(self) -> bool:
        """Whether there is somebody to send to."""
        return self._stream or self._address is not None

    def send(self, *messages: Any) -> None:
        """Send messages in one go; to nobody if nobody has spoken yet.

        Raises:
            LinkError: the other end is gone.
        """
        packed = b"".join(map(self._pack, messages))
        try:
            if self._stream:
                self._socket.sendall(packed)
            elif self._address is not None:
                self._socket.sendto(packed, self._address)
        except ConnectionRefusedError:  # a UDP port that nobody listens at any more
            return
        except OSError as error:
            raise self._gone() from error

    def poll(self) -> list[Any]:
        """Return the messages that are there, without waiting."""
        while select.select([self._socket], [], [], 0.0)[0]:
            self._take()
        messages = list(self._inbox)
        self._inbox.clear()
        return messages

    def receive(self, until_s: float = math.inf) -> Any:
        """Return the next message; ``until_s``: time of the monotonic clock at which it must have come.

        Raises:
            LinkError: the other end is gone, or says nothing for long.
        """
        until_s = min(until_s, time.monotonic() + self.patience_s)
        while not self._inbox:
            if not select.select([self._socket], [], [], max(0.0, until_s - time.monotonic()))[0]:
                raise NoAnswerError(f"{self.peer} has said nothing for {self.patience_s:g} s.")
            self._take()
        return self._inbox.popleft()

    def wait_for(
        self, name: str, fits: Callable[[Any], bool] = lambda message: True, *, within_s: float | None = None
    ) -> Iterator[Any]:
        """Yield messages until one called ``name`` that fits has come, which is the last.

        Raises:
            LinkError: the other end is gone, or the message has not come, whatever else has; ``within_s``: by then,
                instead of the patience with it.
        """
        patience_s, spoke = self.patience_s if within_s is None else within_s, False
        until_s = time.monotonic() + patience_s
        while True:
            if spoke and time.monotonic() > until_s:
                raise NoAnswerError(f"{self.peer} has sent no {name} for {patience_s:g} s.")
            try:
                message, spoke = self.receive(until_s), True
            except NoAnswerError:
                if not spoke:
                    raise
                continue  # it is late
            yield message
            if message.get_type() == name and fits(message):
                return

    def hang_up(self) -> None:
        """End the connection while another thread may wait at it."""
        shut(self._socket if self._stream else None)

    def close(self) -> None:
        """Hang up."""
        self._socket.close()

    def call(self, address: tuple[str, int]) -> None:
        """Send to a UDP address from now on."""
        self._address = address

    def _pack(self, message: Any) -> bytes:
        packed = message.pack(self._mav)
        self._mav.seq = (self._mav.seq + 1) % 256
        return packed

    def _take(self) -> None:
        try:
            data, sender = self._socket.recvfrom(BYTES)
        except ConnectionRefusedError:
            return
        except OSError as error:
            raise self._gone() from error
        if self._stream and not data:
            raise self._gone()
        if not self._stream:
            self._address = sender
        messages = self._mav.parse_buffer(data) or []
        self._inbox.extend(message for message in messages if message.get_type() != "BAD_DATA")

    def _gone(self) -> HungUpError:
        return HungUpError(f"{self.peer} has hung up.")


def shut(opened: socket.socket | None) -> None:
    """Let whoever waits at a TCP socket hear that it is over."""
    if opened is not None:
        with suppress(OSError):
            opened.shutdown(socket.SHUT_RDWR)


def listen(host: str, port: int) -> socket.socket:
    """Open a TCP server; port 0 for any free one.

    Raises:
        LinkError: the port is in use, or cannot be opened.
    """
    server = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    _bind(server, host, port)
    server.listen(1)
    return server


def accept(server: socket.socket, peer: str, patience_s: float = PATIENCE_S) -> socket.socket:
    """Wait for who connects.

    Raises:
        LinkError: nobody does.
    """
    server.settimeout(patience_s)
    try:
        connection, _ = server.accept()
    except OSError as error:
        raise LinkError(
            f"{peer} has not connected to port {server.getsockname()[1]} within {patience_s:g} s."
        ) from error
    connection.setblocking(True)
    return connection


def connect(host: str, port: int, peer: str, patience_s: float = 5.0) -> socket.socket:
    """Connect to a TCP server.

    Raises:
        LinkError: nobody listens there.
    """
    try:
        connection = socket.create_connection((host, port), patience_s)
    except OSError as error:
        raise LinkError(
            f"{peer} does not listen at {host}:{port} ({error.strerror or error}): start it first."
        ) from error
    connection.setblocking(True)
    return connection


def datagrams(host: str, port: int) -> socket.socket:
    """Open a UDP socket; port 0 for any free one.

    Raises:
        LinkError: the port is in use, or cannot be opened.
    """
    connection = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    _bind(connection, host, port)
    return connection


def _bind(opened: socket.socket, host: str, port: int) -> None:
    try:
        opened.bind((host, port))
    except (OSError, OverflowError) as error:
        opened.close()
        raise LinkError(
            f"Port {port} at {host} cannot be opened ({getattr(error, 'strerror', None) or error}): another simulator "
            "or autopilot may run there. Choose another, e.g. port=4561, or 0 for a free one."
        ) from error
