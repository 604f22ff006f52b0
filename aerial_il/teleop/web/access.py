"""Who may come in: who knows the token, calls this machine by its own name, and comes from the page itself."""

import hmac
import re
import secrets
import socket
from ipaddress import ip_address

from aiohttp import web

LOOPBACK = ("127.0.0.1", "localhost", "::1")
ANYWHERE = ("0.0.0.0", "::")
USUAL_PORTS = {"http": 80, "https": 443}  # which browsers leave out
_HOST = re.compile(r"(\[[^\]]*\]|[^:]*)(?::(\d{1,5}))?")


class Access:
    """Checks requests to one page.

    Args:
        host: where it is served. secure: whether over https.

    Attributes:
        token: who knows it may come in; a fresh one each time. port: where it is served, once that is known.
    """

    def __init__(self, host: str, *, secure: bool) -> None:
        self._host, self.token, self.port = host, secrets.token_urlsafe(16), 0
        self._scheme = "https" if secure else "http"

    @property
    def url(self) -> str:
        """Address of the page, with its token."""
        host = self._host if self._host not in ANYWHERE else own_address()
        return f"{self._scheme}://{_bracketed(host)}:{self.port}/?token={self.token}"

    def knows_token(self, request: web.Request) -> bool:
        return hmac.compare_digest(request.query.get("token", "").encode(), self.token.encode())

    def is_addressed(self, request: web.Request) -> bool:
        """Whether the browser asked for this page by its whole address: a foreign name may be made to point here."""
        asked = _HOST.fullmatch(request.host.lower())
        if asked is None or int(asked[2] or USUAL_PORTS[self._scheme]) != self.port:
            return False
        host = asked[1]
        if self._host in LOOPBACK:
            return host in map(_bracketed, LOOPBACK)
        names = map(_bracketed, (*LOOPBACK, *own_names()))
        return host in {name.lower() for name in names} or _is_number(host)

    def is_own_origin(self, request: web.Request) -> bool:
        """Whether a page of this very address asks; programs that are no browsers send no origin."""
        origin = request.headers.get("Origin")
        return origin is None or origin == f"{self._scheme}://{request.host}"


def own_names() -> tuple[str, ...]:
    """Return the names by which other machines know this one."""
    name = socket.gethostname()
    return name, f"{name}.local", socket.getfqdn()


def own_address() -> str:
    """Return this machine's address as others reach it; no packet is sent for it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # kept for documentation (RFC 5737): it leads to the way out
            return probe.getsockname()[0]
        except OSError:
            return "127.0.0.1"


def _bracketed(host: str) -> str:
    """Return a host as it stands before a port: addresses of IPv6 in brackets."""
    return f"[{host}]" if ":" in host else host


def _is_number(host: str) -> bool:
    """Return whether a host, as it stands before a port, is an address in numbers."""
    try:
        return _bracketed(str(ip_address(host.strip("[]")))) == host
    except ValueError:
        return False
