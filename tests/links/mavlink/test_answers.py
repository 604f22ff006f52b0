"""What is asked of an autopilot is asked again while it gets lost, and not waited for without end."""

import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager

import pytest

pytest.importorskip("pymavlink", reason="pymavlink is not installed: pip install 'aerial_il[mavlink]'")

from aerial_il.links.link import LinkError
from aerial_il.links.mavlink import client as clients
from aerial_il.links.mavlink.client import OffboardClient
from aerial_il.links.mavlink.protocol import AUTOPILOT
from aerial_il.links.mavlink.wire import Wire, datagrams, dialect

BEAT_S = 0.02


@contextmanager
def chatting(port: int, *, deaf_to: int) -> Iterator[list[int]]:
    """An autopilot that sends heartbeats and, of the commands that it is sent, accepts all but the first ones."""
    wire, over, heard = Wire(datagrams("127.0.0.1", 0), *AUTOPILOT, "The client"), threading.Event(), list[int]()
    wire.call(("127.0.0.1", port))
    common = dialect()

    def chat() -> None:
        while not over.wait(BEAT_S):
            wire.send(common.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3))
            for message in wire.poll():
                if message.get_type() == "COMMAND_LONG":
                    heard.append(message.confirmation)
                    if len(heard) > deaf_to:
                        wire.send(common.MAVLink_command_ack_message(message.command, common.MAV_RESULT_ACCEPTED))

    thread = threading.Thread(target=chat)
    thread.start()
    try:
        yield heard
    finally:
        over.set()
        thread.join()
        wire.close()


def client(patience_s: float) -> OffboardClient:
    return OffboardClient("ua_quad_arm4", port=0, patience_s=patience_s)


def test_a_command_that_gets_lost_is_sent_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clients, "ASK_AGAIN_S", 0.1)
    with closing(client(5.0)) as asks, chatting(asks.port, deaf_to=2) as heard:
        next(iter(asks._wire.wait_for("HEARTBEAT")))  # whom to send to
        asks.command("MAV_CMD_COMPONENT_ARM_DISARM", 1.0)
    assert heard == [0, 1, 2], "each says how often it was sent before"


def test_a_command_that_nobody_answers_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clients, "ASK_AGAIN_S", 0.1)
    with closing(client(0.5)) as asks, chatting(asks.port, deaf_to=1000):
        next(iter(asks._wire.wait_for("HEARTBEAT")))
        with pytest.raises(LinkError, match=r"has not answered MAV_CMD_COMPONENT_ARM_DISARM, sent \d times"):
            asks.command("MAV_CMD_COMPONENT_ARM_DISARM", 1.0)


def test_an_autopilot_that_tells_no_state_is_not_waited_for() -> None:
    said = r"sent no LOCAL_POSITION_NED for 0\.5 s"
    with closing(client(0.5)) as asks, chatting(asks.port, deaf_to=0), pytest.raises(LinkError, match=said):
        asks.connect()
