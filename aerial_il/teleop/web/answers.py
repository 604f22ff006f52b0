"""What the server answers with: files of the page, documents, refusals, all with the same strict headers; pictures."""

import struct

from aiohttp import web

from aerial_il.teleop.page import PAGE
from aerial_il.teleop.web.film import Shot

TYPES = {".css": "text/css", ".js": "text/javascript"}
ASSETS = {file.name: TYPES[file.suffix] for file in PAGE.iterdir() if file.suffix in TYPES}
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; connect-src 'self'; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
DOCUMENT_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; frame-ancestors 'none'"
HEADERS = {
    "Content-Security-Policy": POLICY,
    "Referrer-Policy": "no-referrer",  # the token stands in the address
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
}


def page_file(name: str, media_type: str = "text/html") -> web.Response:
    """Return a file of the page."""
    text = (PAGE / name).read_text(encoding="utf-8")
    return web.Response(text=text, content_type=media_type, charset="utf-8", headers=HEADERS)


def document(text: str) -> web.Response:
    """Return a page that brings its own style and pictures, and runs nothing."""
    headers = {**HEADERS, "Content-Security-Policy": DOCUMENT_POLICY}
    return web.Response(text=text, content_type="text/html", charset="utf-8", headers=headers)


def refusal(problem: str, status: int = 403) -> web.Response:
    """Return a refusal in words."""
    return web.Response(status=status, text=problem, headers=HEADERS)


def packed(shot: Shot) -> bytes:
    """Return a shot as bytes: number, last message, time (s), number of images, their sizes, the images."""
    sizes = [len(image) for image in shot.images]
    head = struct.pack(f"<IIdI{len(sizes)}I", shot.number, shot.input_seq, shot.taken, len(sizes), *sizes)
    return head + b"".join(shot.images)
