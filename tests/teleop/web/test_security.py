"""The page as an attacker meets it: other names for this machine, other pages, many and slow connections, secrets."""

from __future__ import annotations

import asyncio
import json
import ssl
from contextlib import nullcontext
from pathlib import Path

import aiohttp
import pytest

from aerial_il.core.errors import InvalidValueError
from aerial_il.teleop.input.inbox import Inbox
from aerial_il.teleop.session.session import State
from aerial_il.teleop.web import server as server_module
from aerial_il.teleop.web.server import MAX_CONNECTIONS, MAX_DROPPED, MAX_VISITORS, Server
from aerial_il.teleop.web.tls import fresh_certificate, own_certificate
from tests.teleop.flown import flown
from tests.teleop.hands import shipped
from tests.teleop.web.test_server import an_input, socket, told, until

pytestmark = pytest.mark.render


def together(work) -> None:
    asyncio.run(asyncio.wait_for(work, 60.0))


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
        ("127.0.0.1", {"Host": "10.0.0.7:{port}"}, 403),
        ("127.0.0.1", {"Host": ""}, 403),
        ("0.0.0.0", {"Host": "10.0.0.7:{port}"}, 200),
        ("0.0.0.0", {"Host": "rebound.example:{port}"}, 403),
    ],
)
def test_a_name_that_was_made_to_point_here_is_refused_even_with_the_token(
    host: str, headers: dict[str, str], expected: int
) -> None:
    async def work() -> None:
        server = await a_server(host=host)
        sent = {name: value.format(port=server.port) for name, value in headers.items()}
        async with aiohttp.ClientSession() as session:
            url = f"http://127.0.0.1:{server.port}/?token={server.token}"
            async with session.get(url, headers=sent) as answer:
                assert answer.status == expected
        await server.close()

    together(work())


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
def test_a_socket_of_another_page_is_refused_even_with_the_token(origin: str, welcome: bool) -> None:
    async def work() -> None:
        server = await a_server()
        url = f"http://127.0.0.1:{server.port}/socket?token={server.token}"
        async with aiohttp.ClientSession() as session:
            refused = pytest.raises(aiohttp.WSServerHandshakeError, match="403")
            with nullcontext() if welcome else refused:
                await session.ws_connect(url, headers={"Origin": origin.format(port=server.port)})
        await server.close()

    together(work())


def test_the_token_is_told_to_nobody() -> None:
    """No address is sent on, nothing is cached or framed, no cookie carries it, and no answer repeats it."""

    async def work() -> None:
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

    together(work())


def test_nobody_can_choose_the_token_and_each_session_has_its_own() -> None:
    async def work() -> None:
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

    together(work())


PATHS = ("/../server.py", "/%2e%2e/server.py", "/..%2fserver.py", "//etc/passwd", "/app.js%00.css", "/page/app.js")


@pytest.mark.parametrize("path", PATHS)
def test_no_file_but_those_of_the_page_is_served(path: str) -> None:
    async def work() -> None:
        server = await a_server()
        reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
        writer.write(f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nConnection: close\r\n\r\n".encode())
        answer = await reader.read()
        assert answer.split(b" ")[1] in (b"400", b"404"), answer
        assert b"def " not in answer
        assert b"root:" not in answer
        writer.close()
        await server.close()

    together(work())


def test_connections_that_say_nothing_are_closed_and_those_with_the_token_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server_module, "IDLE_S", 0.3)
    monkeypatch.setattr(server_module, "GUARD_PERIOD_S", 0.1)

    async def work() -> None:
        async with flown(tmp_path) as flight, aiohttp.ClientSession() as session:
            own = await socket(session, flight)
            slow = [await asyncio.open_connection("127.0.0.1", flight.server.port) for _ in range(20)]
            for _, writer in slow:
                writer.write(b"GET / HTTP/1.1\r\nHost: 127.")  # and no more
            ended = await asyncio.wait_for(asyncio.gather(*(reader.read() for reader, _ in slow)), 10.0)
            assert ended == [b""] * 20
            assert (await told(own, "status"))["role"] == "controller"
            for _, writer in slow:
                writer.close()

    together(work())


def test_no_more_connections_than_there_is_room_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server_module, "GUARD_PERIOD_S", 0.1)

    async def work() -> None:
        server = await a_server()
        assert server._runner is not None
        assert server._runner.server is not None
        slow = [await asyncio.open_connection("127.0.0.1", server.port) for _ in range(MAX_CONNECTIONS + 30)]
        while len(server._runner.server.connections) > MAX_CONNECTIONS:
            await asyncio.sleep(0.05)
        for _, writer in slow:
            writer.close()
        await server.close()

    together(work())


def test_no_more_pages_than_there_is_room_for() -> None:
    async def work() -> None:
        server = await a_server()
        url = f"http://127.0.0.1:{server.port}/socket?token={server.token}"
        async with aiohttp.ClientSession() as session:
            pages = [await session.ws_connect(url) for _ in range(MAX_VISITORS)]
            with pytest.raises(aiohttp.WSServerHandshakeError, match="503"):
                await session.ws_connect(url)
            await pages[0].close()
            while len(server.visitors) == MAX_VISITORS:
                await asyncio.sleep(0.01)
            await session.ws_connect(url)
        await server.close()

    together(work())


def test_a_page_that_floods_is_closed_and_the_flight_goes_on(tmp_path: Path) -> None:
    async def work() -> None:
        async with flown(tmp_path) as flight, aiohttp.ClientSession() as session:
            pilot, flood = await socket(session, flight), await socket(session, flight)
            await until(pilot, role="controller")
            for _ in range(MAX_DROPPED + 100):
                await flood.send_str("{")
            while (last := await flood.receive(20.0)).type in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY):
                pass
            assert last.data == aiohttp.WSCloseCode.POLICY_VIOLATION
            found = await until(pilot, visitors=1)
            assert found["role"] == "controller"
            assert sum(found["dropped"].values()) >= MAX_DROPPED

    together(work())


def test_a_spectator_can_neither_fly_nor_record_nor_let_go(tmp_path: Path) -> None:
    async def work() -> None:
        async with flown(tmp_path) as flight, aiohttp.ClientSession() as session:
            pilot = await socket(session, flight)
            await until(pilot, role="controller")
            spectator = await socket(session, flight)
            await until(spectator, role="spectator")
            speaking = asyncio.create_task(hold(pilot))
            while flight.cockpit.status().speed < 0.2:
                await asyncio.sleep(0.01)
            for text in ('{"type":"blur"}', '{"type":"grant"}', an_input(10**6, "KeyS", pressed=("KeyR",))):
                await spectator.send_str(text)
            await asyncio.sleep(0.3)
            assert flight.cockpit.status().speed > 0.2
            assert flight.cockpit.state is State.IDLE
            speaking.cancel()

    together(work())


async def hold(client: aiohttp.ClientWebSocketResponse) -> None:
    for seq in range(1, 10**4):
        await client.send_str(an_input(seq, "KeyW"))
        await asyncio.sleep(0.02)


def test_a_page_cannot_say_what_only_a_device_says() -> None:
    """An arm's joints and a mouse's axes come from the devices themselves."""
    from aerial_il.teleop.web.messages import MessageError, read_message

    for axis in ("leader_1", "mouse_x", "phone_x"):
        with pytest.raises(MessageError):
            read_message(json.dumps({"type": "input", "axes": {axis: 0.5}}))


def test_over_https_the_page_is_the_same_and_its_fingerprint_is_the_one_that_was_told() -> None:
    context, told_fingerprint = fresh_certificate(["127.0.0.1", "localhost", "127.0.0.1"])

    async def work() -> None:
        server = await a_server(tls=context)
        assert server.url.startswith("https://127.0.0.1:")
        digest = bytes.fromhex(told_fingerprint.replace(":", ""))
        async with aiohttp.ClientSession() as session:
            async with session.get(server.url, ssl=aiohttp.Fingerprint(digest)) as answer:
                assert answer.status == 200
            with pytest.raises(aiohttp.ServerFingerprintMismatch):
                await session.get(server.url, ssl=aiohttp.Fingerprint(bytes(32)))
            base = f"https://127.0.0.1:{server.port}"
            url = f"{base}/socket?token={server.token}"
            page = await session.ws_connect(url, ssl=False, headers={"Origin": base})
            assert json.loads((await page.receive(5.0)).data)["type"] == "hello"
            with pytest.raises(aiohttp.WSServerHandshakeError, match="403"):
                await session.ws_connect(url, ssl=False, headers={"Origin": base.replace("https", "http")})
            with pytest.raises(aiohttp.ClientError):
                await session.get(server.url.replace("https", "http"))
        await server.close()

    together(work())


def test_a_certificate_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "c.pem").write_text("no certificate")
    with pytest.raises(InvalidValueError, match=r"c\.pem"):
        own_certificate(str(tmp_path / "c.pem"), str(tmp_path / "c.pem"))
    context, _ = fresh_certificate(["localhost"])
    assert context.minimum_version >= ssl.TLSVersion.TLSv1_2
