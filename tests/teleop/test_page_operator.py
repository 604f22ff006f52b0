"""A person on the page as whom an algorithm learns from: one page through several rounds, which says how they went."""

import asyncio
import errno
import json
import socket
import threading
from itertools import count
from pathlib import Path
from typing import Any

import aiohttp
import pytest

import aerial_il
from aerial_il.algorithms.interactive.costs import FlightCosts
from aerial_il.algorithms.interactive.problem import Operator
from aerial_il.core.errors import StorageError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.recording.writer import EpisodeWriter
from aerial_il.teleop.flight import Site
from aerial_il.teleop.page_operator import PageOperator, progress_of
from aerial_il.teleop.web.server import Server
from aerial_il.workflows.parts.page import operator
from tests.teleop.hands import shipped, world

pytestmark = pytest.mark.render
KEYS = {
    "idle": "KeyR",
    "recording": "KeyR",
    "paused": "KeyP",
    "review": "Enter",
}  # what one presses to keep one flight after the other


class Person(threading.Thread):
    """Somebody with a browser of their own: holds take-over in the midst of each flight, and keeps it."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.url, self.seen, self.done = "", [], threading.Event()

    def open(self, server: Server) -> None:
        self.url = server.url.replace("http", "ws", 1).replace("/?", "/socket?")
        self.start()

    def run(self) -> None:
        asyncio.run(self._fly())

    async def _fly(self) -> None:
        async with aiohttp.ClientSession() as session, session.ws_connect(self.url) as socket:
            seq = 0
            async for message in socket:
                if message.type is aiohttp.WSMsgType.BINARY:
                    continue
                status = json.loads(message.data)
                if status["type"] != "status":
                    continue
                self.seen.append(status)
                state, steps, seq = status["state"], status["steps"], seq + 1
                flown_by_hand = status["person_steps"] > 15
                due = state != "recording" or (steps > 40 and flown_by_hand)
                pressed = [KEYS[state]] if state in KEYS and due and seq % 4 == 0 else []
                held = ["KeyT", "KeyA"] if steps > 10 and not flown_by_hand else []
                await socket.send_str(
                    json.dumps({"type": "input", "seq": seq, "held": held, "pressed": pressed, "axes": {}, "t": 0.0})
                )


def test_two_rounds_on_one_page(tmp_path: Path) -> None:
    env, person = world(task="pick_place"), Person()
    learner, bindings = aerial_il.expert("fa_hexa_arm4", "pick_place"), shipped("keyboard", "gamepad", "touch")
    with PageOperator(env, bindings, Site(size=(60, 80)), operator="ada", opened=person.open) as operator:
        assert isinstance(operator, Operator)
        operator.record(env, learner, tmp_path / "1", seeds=range(5000, 5001), tags={"round": 1})
        flown = list(open_dataset(tmp_path / "1", failures=True))
        operator.notify([FlightCosts.of(flown)], "Round 1 of 2: it learns.")
        operator.record(env, learner, tmp_path / "2", seeds=range(5001, 5002), tags={"round": 2})
    (first,), (second,) = flown, open_dataset(tmp_path / "2", failures=True)
    assert (first.seed, second.seed) == (5000, 5001)
    assert 0 < first.is_intervention.sum() < len(first)
    assert second.provenance["settings"]["round"] == 2
    lessons = [status["lesson"] for status in person.seen if status["lesson"]]
    assert lessons[-1]["message"] == "Round 1 of 2: it learns."
    assert lessons[-1]["rounds"] == [progress_of(FlightCosts.of(flown))]


def test_a_flight_that_does_not_get_onto_the_disk_is_flown_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the first that is kept the disk takes nothing; the round is over once two are there."""
    writes, finish = count(), EpisodeWriter.finish

    def full(self: EpisodeWriter, *args: Any, **kwargs: Any) -> Path:
        if next(writes) == 0:
            raise StorageError(self.part, OSError(errno.ENOSPC, "No space left on device"))
        return finish(self, *args, **kwargs)

    monkeypatch.setattr(EpisodeWriter, "finish", full)
    env, person = world(task="pick_place"), Person()
    bindings, site = shipped("keyboard", "gamepad", "touch"), Site(port=0, size=(60, 80))
    with PageOperator(env, bindings, site, operator="kim", opened=person.open) as shown:
        expert = aerial_il.expert("fa_hexa_arm4", "pick_place")
        shown.record(env, expert, tmp_path / "round", seeds=range(1000, 1002), tags={})
    assert len([*(tmp_path / "round").glob("*/*.mcap")]) == 2
    assert next(writes) >= 3


def test_the_page_moves_to_a_free_port_where_its_own_is_taken(capsys: pytest.CaptureFixture[str]) -> None:
    env, running = world(), threading.active_count()
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        taken = other.getsockname()[1]
        with operator("human", env, port=taken) as person:
            assert person.server.port not in (0, taken)
    said = capsys.readouterr().out
    assert f"port={taken} is taken by another program" in said
    assert f"127.0.0.1:{taken}/" not in said
    assert threading.active_count() <= running, "the page that could not be served has left no thread"
    env.close()


def test_success_counts_only_without_help() -> None:
    costs = FlightCosts(flights=4, successes=3, steps=200, expert_steps=30, solved_alone=1)
    assert progress_of(costs) == {"alone": 25, "share": 15.0}
