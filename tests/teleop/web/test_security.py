"""The page as an attacker meets it: other names for this machine, other pages, many and slow connections, secrets."""

import asyncio
import json
import ssl
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import aiohttp
import pytest

from aerial_il.core.errors import InvalidValueError
from aerial_il.teleop.input.inbox import Inbox
from aerial_il.teleop.session.session import State
from aerial_il.teleop.web import guard
from aerial_il.teleop.web.access import Access
from aerial_il.teleop.web.guard import MAX_CONNECTIONS
from aerial_il.teleop.web.server import MAX_DROPPED, MAX_VISITORS, Server
from aerial_il.teleop.web.tls import fresh_certificate, own_certificate
from tests.patience import until as until_true
from tests.teleop.flown import flown
from tests.teleop.hands import shipped
from tests.teleop.web.test_server import an_input, heard, hold, socket, until

pytestmark = pytest.mark.render


async def a_server(**settings) -> Server:
    server = Server(Inbox(shipped("keyboard")), {}, **settings)
    await server.start()
    return server


@pytest.mark.parametrize(
    ("host", "headers", "expected"),
    [
        ("127.0.0.1", {"Host": "localhost:{port}"}, 200),
        ("127.0.0.1", {"Host": "rebound.example:{port}"}, 403),
        ("127.0.0.1", {"Host": "127.0.0.1.example:{port}"}, 403),
        ("127.0.0.1", {"Host": "[::1]:{port}"}, 200),
        ("127.0.0.1", {"Host": "evil.example@127.0.0.1:{port}"}, 403),
        ("127.0.0.1", {"Host": "127.0.0.1:{port}.evil.example"}, 403),
        ("127.0.0.1", {"Host": "localhost:1"}, 403),
        ("127.0.0.1", {"Host": "localhost"}, 403),
        ("127.0.0.1", {"Host": "10.0.0.7:{port}"}, 403),
        ("127.0.0.1", {"Host": ""}, 403),
        ("0.0.0.0", {"Host": "10.0.0.7:{port}"}, 200),
        ("0.0.0.0", {"Host": "rebound.example:{port}"}, 403),
    ],
)
async def test_a_foreign_name_is_refused_even_with_the_token(host: str, headers: dict[str, str], expected: int) -> None:
    server = await a_server(host=host)
    sent = {name: value.format(port=server.port) for name, value in headers.items()}
    async with aiohttp.ClientSession() as session:
        url = f"http://127.0.0.1:{server.port}/?token={server.token}"
        async with session.get(url, headers=sent) as answer:
            assert answer.status == expected
    await server.close()


@pytest.mark.parametrize(
    ("origin", "welcome"),
    [
        ("http://127.0.0.1:{port}", True),
        ("https://127.0.0.1:{port}", False),
        ("http://127.0.0.1:1", False),
        ("http://127.0.0.1", False),
        ("http://localhost:{port}", False),
        ("null", False),
        ("http://evil.example", False),
        ("http://127.0.0.1:{port}.evil.example", False),
    ],
)
async def test_a_socket_of_another_page_is_refused_even_with_the_token(origin: str, welcome: bool) -> None:
    server = await a_server()
    url = f"http://127.0.0.1:{server.port}/socket?token={server.token}"
    async with aiohttp.ClientSession() as session:
        refused = pytest.raises(aiohttp.WSServerHandshakeError, match="403")
        with nullcontext() if welcome else refused:
            await session.ws_connect(url, headers={"Origin": origin.format(port=server.port)})
    await server.close()


async def test_the_token_is_given_to_nobody() -> None:
    """No address is sent on, nothing is cached or framed, no cookie carries it, and no answer repeats it."""
    server = await a_server()
    base = f"http://127.0.0.1:{server.port}"
    async with aiohttp.ClientSession() as session:
        for path in (f"/?token={server.token}", "/app.js", "/style.css", "/none", "/?token=wrong"):
            async with session.get(base + path) as answer:
                assert server.token not in await answer.text()
                assert answer.headers["Referrer-Policy"] == "no-referrer"
                assert answer.headers["Cache-Control"] == "no-store"
                assert answer.headers["X-Content-Type-Options"] == "nosniff"
                assert "frame-ancestors 'none'" in answer.headers["Content-Security-Policy"]
                assert "Set-Cookie" not in answer.headers
    await server.close()


async def test_each_session_has_a_token_of_its_own() -> None:
    first, second = await a_server(), await a_server()
    assert first.token != second.token
    assert len(first.token) >= 20
    async with aiohttp.ClientSession() as session:
        for query in (f"token={second.token}", "token=", f"token={first.token}x", f"token=x&token={first.token}"):
            async with session.get(f"http://127.0.0.1:{first.port}/?{query}") as answer:
                assert answer.status == 403, query
        cookies = {"token": first.token}
        async with session.get(f"http://127.0.0.1:{first.port}/", cookies=cookies) as answer:
            assert answer.status == 403
    await first.close()
    await second.close()


PATHS = (
    "/index.html",
    "/../server.py",
    "/%2e%2e/server.py",
    "/..%2fserver.py",
    "//etc/passwd",
    "/app.js%00.css",
    "/page/app.js",
)


@pytest.mark.parametrize("path", PATHS)
async def test_no_file_but_those_of_the_page_is_served(path: str) -> None:
    server = await a_server()
    reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
    writer.write(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nConnection: close\r\n\r\n".encode())
    answer = await reader.read()
    assert answer.split(b" ")[1] in (b"400", b"404"), answer
    assert b"def " not in answer
    assert b"root:" not in answer
    writer.close()
    await server.close()


async def test_connections_that_say_nothing_are_closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "PERIOD_S", 0.1)
    async with flown(tmp_path) as flight, aiohttp.ClientSession() as session:
        own = await socket(session, flight)
        monkeypatch.setattr(guard, "IDLE_S", 0.3)
        slow = [await asyncio.open_connection("127.0.0.1", flight.server.port) for _ in range(20)]
        for _, writer in slow:
            writer.write(b"GET / HTTP/1.1\r\nHost: 127.")  # and no more
        ended = await asyncio.gather(*(reader.read() for reader, _ in slow))
        assert ended == [b""] * 20
        assert (await heard(own, "status"))["role"] == "controller"
        for _, writer in slow:
            writer.close()


async def test_connections_are_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "PERIOD_S", 0.1)
    server = await a_server()
    slow = [await asyncio.open_connection("127.0.0.1", server.port) for _ in range(MAX_CONNECTIONS + 30)]
    closed, waiting = 0, [asyncio.create_task(reader.read()) for reader, _ in slow]
    while closed < 30:
        await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
        closed = sum(task.done() for task in waiting)
    assert closed == 30
    for _, writer in slow:
        writer.close()
    await server.close()


async def test_pages_are_limited() -> None:
    server = await a_server()
    url = f"http://127.0.0.1:{server.port}/socket?token={server.token}"
    async with aiohttp.ClientSession() as session:
        pages = [await session.ws_connect(url) for _ in range(MAX_VISITORS)]
        with pytest.raises(aiohttp.WSServerHandshakeError, match="503"):
            await session.ws_connect(url)
        await pages[0].close()
        await until_true(lambda: len(server.visitors) < MAX_VISITORS)
        await session.ws_connect(url)
    await server.close()


async def test_a_page_that_floods_is_closed_and_the_flight_goes_on(tmp_path: Path) -> None:
    async with flown(tmp_path) as flight, aiohttp.ClientSession() as session:
        pilot, flood = await socket(session, flight), await socket(session, flight)
        await until(pilot, role="controller")
        for _ in range(MAX_DROPPED + 100):
            await flood.send_str("{")
        while (last := await flood.receive()).type in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY):
            pass
        assert last.data == aiohttp.WSCloseCode.POLICY_VIOLATION
        status = await until(pilot, visitors=1)
        assert status["role"] == "controller"
        assert sum(status["dropped"].values()) >= MAX_DROPPED


async def test_a_spectator_can_neither_fly_nor_record_nor_let_go(tmp_path: Path) -> None:
    async with flown(tmp_path) as flight, aiohttp.ClientSession() as session:
        pilot = await socket(session, flight)
        await until(pilot, role="controller")
        spectator = await socket(session, flight)
        await until(spectator, role="spectator")
        speaking = asyncio.create_task(hold(pilot))
        await until_true(lambda: flight.cockpit.status().speed > 0.2)
        for text in ('{"type":"blur"}', '{"type":"grant"}', an_input(10**6, "KeyS", pressed=("KeyR",))):
            await spectator.send_str(text)
        await spectator.send_str('{"type":"ping"}')
        await heard(spectator, "pong")  # so the others have been read
        await until_true(lambda: flight.cockpit.status().speed > 0.2)
        assert flight.cockpit.state is State.IDLE
        assert flight.cockpit.input_seq < 10**6
        speaking.cancel()


def test_a_page_cannot_say_what_only_a_device_says() -> None:
    """An arm's joints and a mouse's axes come from the devices themselves."""
    from aerial_il.teleop.web.messages import MessageError, read_message

    for axis in ("leader_1", "mouse_x", "phone_x"):
        with pytest.raises(MessageError):
            read_message(json.dumps({"type": "input", "axes": {axis: 0.5}}))


async def test_over_https_the_fingerprint_is_the_one_that_was_said() -> None:
    context, fingerprint = fresh_certificate(["127.0.0.1", "localhost", "127.0.0.1"])
    server = await a_server(tls=context)
    assert server.url.startswith("https://127.0.0.1:")
    digest = bytes.fromhex(fingerprint.replace(":", ""))
    async with aiohttp.ClientSession() as session:
        async with session.get(server.url, ssl=aiohttp.Fingerprint(digest)) as answer:
            assert answer.status == 200
        with pytest.raises(aiohttp.ServerFingerprintMismatch):
            await session.get(server.url, ssl=aiohttp.Fingerprint(bytes(32)))
        base = f"https://127.0.0.1:{server.port}"
        url = f"{base}/socket?token={server.token}"
        page = await session.ws_connect(url, ssl=False, headers={"Origin": base})
        assert json.loads((await page.receive()).data)["type"] == "hello"
        with pytest.raises(aiohttp.WSServerHandshakeError, match="403"):
            await session.ws_connect(url, ssl=False, headers={"Origin": base.replace("https", "http")})
        with pytest.raises(aiohttp.ClientError):
            await session.get(server.url.replace("https", "http"))
    await server.close()


def test_a_certificate_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "c.pem").write_text("no certificate")
    with pytest.raises(InvalidValueError, match=r"c\.pem"):
        own_certificate(str(tmp_path / "c.pem"), str(tmp_path / "c.pem"))
    context, _ = fresh_certificate(["localhost"])
    assert context.minimum_version >= ssl.TLSVersion.TLSv1_2


@pytest.mark.parametrize(("secure", "port"), [(False, 80), (True, 443)])
def test_the_usual_port_is_left_out_by_browsers(secure: bool, port: int) -> None:
    access = Access("127.0.0.1", secure=secure)
    for served, hosts in ((port, ("localhost", f"localhost:{port}", "[::1]")), (8443, ("localhost:8443",))):
        access.port = served
        for host in hosts:
            assert access.is_addressed(SimpleNamespace(host=host))  # type: ignore[arg-type]
        for host in ("evil.example", "localhost:1", "localhost:", ""):
            assert not access.is_addressed(SimpleNamespace(host=host))  # type: ignore[arg-type]
