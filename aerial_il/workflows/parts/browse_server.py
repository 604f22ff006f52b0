"""Serves the page that browses a dataset: to this machine alone, and to who knows its token."""

from __future__ import annotations

import hmac
import json
import secrets
from collections.abc import Mapping
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
from aerial_il.data.table import Row, read_table
from aerial_il.presentation.films.scene_renderer import obstacle
from aerial_il.presentation.films.video import film_recording
from aerial_il.presentation.pages.browse import browse_page, table_of
from aerial_il.workflows.edit import edit_marked

HOST, NAMES = "127.0.0.1", ("127.0.0.1", "localhost")
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


class BrowseServer(ThreadingHTTPServer):
    """The page of one dataset, its films and its edits.

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
        self._worker = ThreadPoolExecutor(1)  # one edit or film after the other; a renderer stays in its thread

    @property
    def url(self) -> str:
        """Address of the page, with its token."""
        return f"http://{HOST}:{self.server_port}/?token={self.token}"

    def rows(self) -> list[Row]:
        """Return the table as it is now."""
        try:
            return read_table(open_dataset(self.dataset, failures=True, states=False))
        except AerialError:
            if (Path(self.dataset) / "trash").is_dir():  # all of it was deleted
                return []
            raise

    def edit(self, asked: Mapping[str, Any]) -> dict[str, Any]:
        """Make an edit, or take the last one back; return the table and what was done."""
        said = self._worker.submit(edit_marked, self.dataset, **asked).result()
        return {**table_of(self.rows()), "said": said}

    def film(self, uid: str) -> bytes:
        """Return the film of an episode."""
        return self._worker.submit(self._film, uid).result()

    def server_close(self) -> None:
        super().server_close()
        self._worker.shutdown(cancel_futures=True)

    def _film(self, uid: str) -> bytes:
        file = open_dataset(self.dataset, failures=True).files.get(uid)
        problem = "it has no recording of its own" if file is None else obstacle()
        if file is None or problem:
            raise InvalidValueError(f"No film of {uid}: {problem}.")
        with TemporaryDirectory() as folder:
            return film_recording(read_episode(file), Path(folder) / "film.mp4").read_bytes()


class _Handler(BaseHTTPRequestHandler):
    @property
    def _home(self) -> BrowseServer:
        assert isinstance(self.server, BrowseServer)
        return self.server

    def do_GET(self) -> None:
        if self._may_enter() and urlsplit(self.path).path == "/":
            page = browse_page(self._home.dataset, self._home.rows())
            self._answer(HTTPStatus.OK, page.encode(), "text/html; charset=utf-8")
        else:
            self._answer(HTTPStatus.FORBIDDEN, b"Open the address that was printed, with its token.")

    def do_POST(self) -> None:
        if not self._may_enter():
            self._answer(HTTPStatus.FORBIDDEN, b"Open the address that was printed, with its token.")
            return
        try:
            asked = self._asked()
            if urlsplit(self.path).path == "/film":
                self._answer(HTTPStatus.OK, self._home.film(str(asked["uid"])), "video/mp4")
            else:
                self._answer(HTTPStatus.OK, json.dumps(self._home.edit(asked)).encode(), "application/json")
        except (AerialError, OSError, ValueError, KeyError, TypeError) as error:
            self._answer(HTTPStatus.BAD_REQUEST, str(error).encode())

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing of requests, in whose addresses the token stands."""

    def _may_enter(self) -> bool:
        """Whether who asks knows the token, calls this machine by its own name, and is no other page."""
        parts, host = urlsplit(self.path), self.headers.get("Host", "")
        given = parse_qs(parts.query).get("token", [""])[0]
        named = host in {f"{name}:{self._home.server_port}" for name in NAMES}
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
