"""Who may fly, and what the server believes: spoken to as a hostile or clumsy client would."""

import asyncio
import json
import struct
from itertools import count
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from aerial_il.teleop.session.session import State
from aerial_il.teleop.web import messages, visitors
from aerial_il.teleop.web.messages import BURST, Bucket, MessageError, read_message
from tests.patience import until as until_true
from tests.teleop.flown import Flown, flown

pytestmark = pytest.mark.render


async def socket(session: aiohttp.ClientSession, flight: Flown, **headers: str) -> aiohttp.ClientWebSocketResponse:
    url = f"http://127.0.0.1:{flight.server.port}/socket?token={flight.server.token}"
    return await session.ws_connect(url, headers=headers)


async def heard(client: aiohttp.ClientWebSocketResponse, kind: str) -> dict[str, Any]:
    """Return the next message of a kind."""
    while True:
        message = await client.receive()
        assert message.type in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY), message
        if message.type is aiohttp.WSMsgType.TEXT and (content := json.loads(message.data))["type"] == kind:
            return content


async def until(client: aiohttp.ClientWebSocketResponse, **wanted: Any) -> dict[str, Any]:
    """Return the first status that says what is wanted; the test's time limit is how long it may take."""
    while True:
        status = await heard(client, "status")
        if all(status[name] == value for name, value in wanted.items()):
            return status


async def hold(client: aiohttp.ClientWebSocketResponse) -> None:
    """Hold a key, until cancelled."""
    for seq in count(2):
        await client.send_str(an_input(seq, "KeyW"))
        await asyncio.sleep(0.02)


def an_input(seq: int, *held: str, pressed: tuple[str, ...] = ()) -> str:
    return json.dumps({"type": "input", "seq": seq, "held": held, "pressed": pressed, "axes": {}, "t": 1.0})


async def test_bad_messages_are_dropped_and_the_flight_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async with flown(tmp_path) as flight, aiohttp.ClientSession() as session:
        client = await socket(session, flight)
        bad = ["", "{", "[]", '{"type":"fly"}', an_input(-1), '{"type":"input","axes":{"left_x":2}}', "[" * 3000]
        for text in bad:
            await client.send_str(text)
        await client.send_bytes(b"\0")
        await client.send_str(json.dumps({"type": "input", "held": ["x" * 5000]}))
        await until(client, dropped={"malformed": len(bad) + 1, "oversized": 1})
        monkeypatch.setattr(messages, "MAX_RATE", 0.0)  # however slowly the flood comes
        for seq in range(int(BURST) + 325):
            await client.send_str(an_input(seq + 1))
        await until_true(lambda: flight.server.visitors.dropped["flooding"] > 200)
        assert (await heard(client, "status"))["role"] == "controller"
        ticks = flight.cockpit.tick_count
        await until_true(lambda: flight.cockpit.tick_count > ticks)


async def test_one_flies_the_others_watch_until_it_is_handed_over(tmp_path: Path) -> None:
    async with flown(tmp_path) as flight, aiohttp.ClientSession() as session:
        first = await socket(session, flight)
        await heard(first, "status")
        second = await socket(session, flight)
        assert (await heard(second, "status"))["role"] == "spectator"
        await second.send_str(an_input(9, pressed=("KeyR",)))
        await second.send_str('{"type":"grant"}')
        await second.send_str('{"type":"ask"}')
        assert (await until(second, asked=2))["role"] == "spectator"
        assert flight.cockpit.state is State.IDLE, "a spectator's keys do nothing"
        assert flight.cockpit.input_seq == 0
        await first.send_str('{"type":"grant"}')
        await until(second, role="controller")
        await until(first, role="spectator")
        await second.send_str(an_input(9, pressed=("KeyR",)))
        await until(second, state="countdown")
        await second.close()
        await until(first, free=True)
        await first.send_str('{"type":"ask"}')
        await until(first, role="controller")


async def test_a_forgotten_page_hands_over_when_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async with flown(tmp_path) as flight, aiohttp.ClientSession() as session:
        forgotten = await socket(session, flight)
        await forgotten.send_str(an_input(1, "KeyW"))
        await until_true(lambda: flight.cockpit.input_seq == 1)
        owner = await socket(session, flight)
        await owner.send_str('{"type":"ask"}')
        assert (await until(owner, asked=2))["role"] == "spectator", "somebody just flew"
        monkeypatch.setattr(visitors, "FORGOTTEN_S", 0.0)
        await until(owner, role="controller")
        assert (await until(forgotten, role="spectator"))["asked"] == 0


@pytest.mark.usefixtures("unhurried")
async def test_a_lost_page_hovers_pauses_and_goes_on(tmp_path: Path) -> None:
    async with flown(tmp_path) as flight, aiohttp.ClientSession() as session:
        client = await socket(session, flight)
        await client.send_str(an_input(1, pressed=("KeyR",)))
        holding = asyncio.create_task(hold(client))
        await until_true(lambda: flight.cockpit.status().steps > 10)
        assert flight.cockpit.state is State.RECORDING
        holding.cancel()
        await client.close()
        again = await socket(session, flight)
        assert (await until(again, state="paused"))["steps"] > 10
        await again.send_str(an_input(1, pressed=("KeyP",)))
        await until(again, state="recording")


async def test_no_more_than_two_pictures_are_on_their_way(tmp_path: Path) -> None:
    async with flown(tmp_path) as flight, aiohttp.ClientSession() as session:
        client = await socket(session, flight)
        first, second = await picture(client), await picture(client)
        await until_true(lambda: flight.server.shot.number > second + 3)
        for _ in range(3):  # a picture that was sent meanwhile would stand before them
            assert (await client.receive()).type is aiohttp.WSMsgType.TEXT
        await client.send_str(json.dumps({"type": "ack", "seq": second}))
        assert first < second < await picture(client) - 2, "it is the latest picture, not the next one"


async def picture(client: aiohttp.ClientWebSocketResponse) -> int:
    """Return the number of the next picture."""
    while (message := await client.receive()).type is not aiohttp.WSMsgType.BINARY:
        assert message.type is aiohttp.WSMsgType.TEXT, message
    return struct.unpack_from("<I", message.data)[0]


@pytest.mark.parametrize(
    "text",
    [
        '{"type":"input","seq":true}',
        '{"type":"input","seq":1.5}',
        '{"type":"input","axes":[]}',
        '{"type":"input","axes":{"up":1}}',
        '{"type":"input","axes":{"left_x":"1"}}',
        '{"type":"input","axes":{"left_x":NaN}}',
        '{"type":"input","held":"KeyW"}',
        '{"type":"input","held":[1]}',
        '{"type":"input","t":1e400}',
        f'{{"type":"input","t":{"9" * 400}}}',
        f'{{"type":"input","axes":{{"left_x":{"9" * 400}}}}}',
        '{"type":["input"]}',
    ],
)
def test_messages_of_the_wrong_shape_are_not_believed(text: str) -> None:
    with pytest.raises(MessageError):
        read_message(text)


def test_the_bucket_lets_a_page_through_and_a_flood_not() -> None:
    now = [0.0]
    bucket = Bucket(lambda: now[0])
    for _ in range(500):  # 60 messages a second
        now[0] += 1 / 60
        assert bucket.admits()
    assert sum(bucket.admits() for _ in range(1000)) <= BURST
    now[0] += 4.0
    late = 2.5 * (50 + 30 + 2)  # inputs, acknowledged pictures and pings of a server that was held up
    assert all(bucket.admits() for _ in range(int(late))), "a press among them is not lost"
