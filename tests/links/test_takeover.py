"""A person on the page watches a policy fly a robot over a link, and takes over from it."""

import asyncio
import json
import threading

import aiohttp
import numpy as np
import pytest

from aerial_il.core.errors import InvalidValueError
from aerial_il.links.environment import LinkedEnvironment
from aerial_il.links.pilot import LinkPilot
from aerial_il.links.robot import SimulatedRobot
from aerial_il.links.simulated.link import Simulated
from aerial_il.links.takeover import TakeOver
from aerial_il.teleop.flight import Site
from aerial_il.teleop.web.server import Server
from tests.links.test_fly import ROBOT, TASK, fresh_policy
from tests.teleop.hands import shipped

pytestmark = pytest.mark.render
TAKE_OVER, LEFT = "KeyT", "KeyA"


class Person(threading.Thread):
    """Somebody with a browser of their own, who holds the keys in ``held`` and leaves when told to."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.url, self.held, self.gone = "", set[str](), threading.Event()
        self.seen: list[dict] = []

    def open(self, server: Server) -> None:
        self.url = server.url.replace("http", "ws", 1).replace("/?", "/socket?")
        self.start()

    def run(self) -> None:
        asyncio.run(self._watch())

    async def _watch(self) -> None:
        async with aiohttp.ClientSession() as session, session.ws_connect(self.url) as socket:
            seq = 0
            async for message in socket:
                if self.gone.is_set():
                    return
                if message.type is aiohttp.WSMsgType.BINARY:
                    continue
                status = json.loads(message.data)
                self.seen += [status] if status["type"] == "status" else []
                seq += 1
                frame = {"type": "input", "seq": seq, "held": sorted(self.held), "pressed": [], "axes": {}, "t": 0.0}
                await socket.send_str(json.dumps(frame))


def flight(person: Person, *, clock: str = "wall") -> tuple[LinkedEnvironment, TakeOver]:
    link = Simulated(clock=clock).connect(lambda: SimulatedRobot(ROBOT, TASK))  # pyright: ignore[reportArgumentType]
    env, site = LinkedEnvironment(link), Site(port=0, size=(60, 80))
    pilot, bindings = LinkPilot(fresh_policy("mlp")), shipped("keyboard", "gamepad", "touch")
    return env, TakeOver(pilot, env, bindings, site, operator="kim", opened=person.open)


def test_a_person_takes_over_and_hands_back() -> None:
    person = Person()
    env, shared = flight(person)
    with shared:
        shared.attach(env)
        obs = env.reset(0)
        shared.reset()
        shared.begin(np.array([0]))
        fliers, meant = [], []
        for _ in range(700):
            person.held = {TAKE_OVER, LEFT} if fliers.count("policy") > 20 and fliers.count("person") < 40 else set()
            obs = env.step(shared.act(obs)).obs
            watched = bool(person.seen) and not person.seen[-1]["dead"]
            fliers.append("person" if shared.is_intervention[0] else "policy" if watched else "nobody")
            meant.append(bool(np.isfinite(shared.expert_action).all()))
            if fliers.count("person") >= 40 and fliers[-20:].count("policy") == 20:
                break
    env.close()
    assert fliers[0] == "nobody", "nobody watches yet: the robot hovers"
    assert fliers.count("person") >= 40
    assert meant == [flier == "person" for flier in fliers]
    assert fliers[-1] == "policy", "it flies on"
    assert shared.made_of(0)["person_ticks"] >= 40
    assert person.seen[-1]["flier"] in ("policy", "person")


def test_without_anybody_on_the_page_the_robot_stays() -> None:
    person = Person()
    env, shared = flight(person)
    shared.attach(env)
    obs = env.reset(0)
    shared.reset()
    start = obs["ee_pos"].copy()
    for _ in range(60):
        obs = env.step(shared.act(obs)).obs
    env.close()
    assert np.linalg.norm(obs["ee_pos"] - start) < 0.03


def test_a_success_that_nobody_watched_is_no_demonstration() -> None:
    person = Person()
    env, shared = flight(person)
    shared.attach(env)
    obs = env.reset(0)
    shared.begin(np.array([0]))
    shared.reset()
    for _ in range(5):
        obs = env.step(shared.act(obs)).obs
    assert "nobody was on the page for 5 ticks" in shared.objection(0)
    env.reset(0)
    shared.begin(np.array([0]))
    assert not shared.objection(0)
    env.close()


def test_it_is_waited_for_somebody_on_the_page() -> None:
    person = Person()
    env, shared = flight(person)
    with shared:
        shared.wait()
        assert len(shared.server.visitors)
    env.close()


def test_what_the_guard_objects_to_is_said_on_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    person = Person()
    env, shared = flight(person)
    with shared:
        shared.attach(env)
        obs = env.reset(0)
        shared.reset()
        shared.begin(np.array([0]))
        said: set[str] = set()
        for tick in range(300):
            if tick == 40:
                monkeypatch.setattr(env.loop.link, "read", lambda stale=env.loop.reading: stale)
            obs = env.step(shared.act(obs)).obs
            said |= {each["message"][:22] for each in person.seen[-1:]}
            if "no news of the robot f" in said:
                break
    env.close()
    assert "no news of the robot f" in said
    assert said <= {"The policy flies. Hold", "no news of the robot f"}


def test_a_robot_whose_time_waits_is_refused() -> None:
    with pytest.raises(InvalidValueError, match=r"link\.clock=wall"):
        flight(Person(), clock="lockstep")
