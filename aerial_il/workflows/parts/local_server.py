"""Serves a page to this machine alone, and to who knows its token: what pages that edit or judge have in common."""

import hmac
import json
import secrets
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.parse import parse_qs, urlsplit

from aerial_il.core.bounded import parse_json
from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.recording.reader import read_episode
from aerial_il.presentation.films.scene_renderer import obstacle
from aerial_il.presentation.films.video import film_recording

HOST, NAMES = "127.0.0.1", ("127.0.0.1", "localhost")
USUAL_PORT = 80  # which browsers leave out
MOST_BYTES = 8 << 20  # of a question
HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:; media-src blob:; "
        "connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
    ),
    "Referrer-Policy": "no-referrer",  # the token stands in the address
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Resource-Policy": "same-origin",
}


class LocalServer(ThreadingHTTPServer, ABC):
    """The page of one dataset, and its films.

    Args:
        dataset: path. port: 0 for any that is free.

    Raises:
        InvalidValueError: another program listens there.
    """

    daemon_threads = True

    def __init__(self, dataset: str, port: int) -> None:
        try:
            super().__init__((HOST, port), _Handler)
        except OSError as error:
            raise InvalidValueError(f"port={port} is taken ({error.strerror}). Choose another, or port=0.") from error
        self.dataset, self.token = dataset, secrets.token_urlsafe(16)
        self._worker = ThreadPoolExecutor(1)  # one after the other; a renderer stays in its thread

    @property
    def url(self) -> str:
        """Address of the page, with its token."""
        return f"http://{HOST}:{self.server_port}/?token={self.token}"

    @abstractmethod
    def page(self) -> str:
        """Return the page as it is now."""

    @abstractmethod
    def answer(self, path: str, asked: Mapping[str, Any]) -> Mapping[str, Any] | bytes:
        """Return what the page asks for: JSON values, or a film.

        Raises:
            AerialError, ValueError, KeyError, TypeError: the question has no answer, for the reason given.
        """

    def film(self, uid: str, steps: range | None = None) -> bytes:
        """Return the film of an episode, or of some consecutive steps of it."""
        return self.in_turn(self._film, uid, steps)

    def in_turn[**P, T](self, work: Callable[P, T], *args: P.args, **options: P.kwargs) -> T:
        """Return what ``work`` makes once all that was asked for before is done."""
        return self._worker.submit(work, *args, **options).result()

    def server_close(self) -> None:
        super().server_close()
        self._worker.shutdown(cancel_futures=True)

    def _film(self, uid: str, steps: range | None) -> bytes:
        file = open_dataset(self.dataset, failures=True).files.get(uid)
        problem = "it has no recording of its own" if file is None else obstacle()
        if file is None or problem:
            raise InvalidValueError(f"No film of {uid}: {problem}.")
        with TemporaryDirectory() as folder:
            return film_recording(read_episode(file), Path(folder) / "film.mp4", steps=steps).read_bytes()


class _Handler(BaseHTTPRequestHandler):
    @property
    def _home(self) -> LocalServer:
        assert isinstance(self.server, LocalServer)
        return self.server

    def do_GET(self) -> None:
        if self._may_enter() and urlsplit(self.path).path == "/":
            page = self._home.page()
            self._answer(HTTPStatus.OK, page.encode(), "text/html; charset=utf-8")
        else:
            self._answer(HTTPStatus.FORBIDDEN, b"Open the address that was printed, with its token.")

    def do_POST(self) -> None:
        if not self._may_enter():
            self._answer(HTTPStatus.FORBIDDEN, b"Open the address that was printed, with its token.")
            return
        try:
            answer = self._home.answer(urlsplit(self.path).path, self._asked())
            film = isinstance(answer, bytes)
            body = answer if film else json.dumps(answer).encode()
            self._answer(HTTPStatus.OK, body, "video/mp4" if film else "application/json")
        except (AerialError, OSError, ValueError, KeyError, TypeError) as error:
            self._answer(HTTPStatus.BAD_REQUEST, str(error).encode())

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing of requests, in whose addresses the token stands."""

    def _may_enter(self) -> bool:
        """Whether who asks knows the token, calls this machine by its own name, and is no other page."""
        parts, host = urlsplit(self.path), self.headers.get("Host", "")
        given = parse_qs(parts.query).get("token", [""])[0]
        port = self._home.server_port
        named = host in {f"{name}:{port}" for name in NAMES} or (port == USUAL_PORT and host in NAMES)
        own = self.headers.get("Origin") in (None, f"http://{host}")
        return named and own and hmac.compare_digest(given.encode(), self._home.token.encode())

    def _asked(self) -> dict[str, Any]:
        size = int(self.headers.get("Content-Length", 0))
        if not 0 < size <= MOST_BYTES:
            raise InvalidValueError(f"A question has 1 to {MOST_BYTES} bytes, not {size}.")
        asked = parse_json(self.rfile.read(size))
        if not isinstance(asked, dict):
            raise InvalidValueError("A question is a JSON object.")
        return asked

    def _answer(self, status: HTTPStatus, body: bytes, media_type: str = "text/plain; charset=utf-8") -> None:
        self.send_response(status)
        for name, value in {**HEADERS, "Content-Type": media_type, "Content-Length": str(len(body))}.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)
