"""Devices that no browser reads, in flight: merged with the page's, lost and found again, and replayed to the bit."""

import asyncio
import json
from pathlib import Path

import aiohttp
import numpy as np
import pytest

from aerial_il.core.errors import InvalidValueError
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.recording.reader import read_episode
from aerial_il.data.replay import replay
from aerial_il.teleop.piloting.pilot import check_leader
from aerial_il.teleop.session.refly import refly
from tests.patience import until
from tests.teleop.flown import Flown, flown
from tests.teleop.hands import shipped, world
from tests.teleop.simulated import FakeArm, FakeMouse, buttons, simulated, translation

pytestmark = pytest.mark.render


class Page:
    """A page that says it is there, as often as a browser's does."""

    def __init__(self, client: aiohttp.ClientWebSocketResponse) -> None:
        self.client, self._seq = client, 0
        self.pressed: list[str] = []
        self.held: list[str] = []
        self.extra: dict = {}
        self._speaking = asyncio.create_task(self._speak())
        self._hearing = asyncio.create_task(self._hear())

    def hush(self) -> None:
        self._speaking.cancel()

    async def _hear(self) -> None:
        async for _ in self.client:
            pass

    async def _speak(self) -> None:
        while True:
            self._seq += 1
            pressed, self.pressed = self.pressed, []
            held = [*self.held, *pressed]
            message = {"type": "input", "seq": self._seq, "held": held, "pressed": pressed, "axes": {}, "t": 1.0}
            if self.client.closed:
                return
            await self.client.send_str(json.dumps({**message, **self.extra}))
            await asyncio.sleep(0.02)


async def a_page(session: aiohttp.ClientSession, flight: Flown) -> Page:
    return Page(await session.ws_connect(f"http://127.0.0.1:{flight.server.port}/socket?token={flight.server.token}"))


@pytest.mark.usefixtures("unhurried", "patient")
async def test_a_spacemouse_flies_is_unplugged_and_flies_on(tmp_path: Path) -> None:
    mouse: FakeMouse
    with simulated("spacemouse", tmp_path / "usb") as mouse:
        async with (
            flown(
                tmp_path / "out", devices=("keyboard", "spacemouse"), hardware={"spacemouse": mouse.settings}
            ) as flight,
            aiohttp.ClientSession() as session,
        ):
            status = flight.cockpit.status
            mouse.send(translation(0, -350, 0))
            await asyncio.sleep(0.3)
            assert status().speed == 0.0, "nobody is at the page"
            mouse.send(translation(0, 0, 0))
            page = await a_page(session, flight)
            await until(lambda: status().speed == 0.0 and not status().dead)
            pushing = asyncio.create_task(push(mouse))
            await until(lambda: status().speed > 0.3)
            mouse.send(buttons(2))
            await until(lambda: status().state == "recording")
            await until(lambda: status().steps >= 25)
            pushing.cancel()
            mouse.unplug()
            await until(lambda: status().state == "paused")
            assert "spacemouse is gone" in status().message
            await asyncio.sleep(0.1)
            mouse.plug_in()
            await until(lambda: status().message == "spacemouse is back.")
            page.pressed = ["KeyP"]
            await until(lambda: status().state == "recording")
            pushing = asyncio.create_task(push(mouse))
            await until(lambda: status().speed > 0.3)
            page.pressed = ["KeyR"]
            await until(lambda: status().state == "review")
            page.pressed = ["Enter"]
            await until(lambda: sum(status().counts.values()) == 1)
            pushing.cancel()
            page.hush()
    env = world()
    (file,) = DatasetFolder(tmp_path / "out").files("failures")
    episode = read_episode(file)
    assert np.ptp(episode.actions[:, 0]) > 0.05, "the mouse was flown"
    assert refly(env, episode) == replay(env, episode) == len(episode)


async def push(mouse: FakeMouse) -> None:
    """Hold it ahead, as it reports while it is deflected."""
    while True:
        mouse.send(translation(0, -350, 0))
        await asyncio.sleep(0.016)


@pytest.mark.usefixtures("patient")
async def test_a_leader_arm_moves_joints_while_keys_move_the_base(tmp_path: Path) -> None:
    arm: FakeArm
    with simulated("leader_arm", tmp_path / "usb") as arm:
        used = {"devices": ("keyboard", "leader_arm"), "hardware": {"leader_arm": arm.settings}}
        async with flown(tmp_path / "out", action="base_joint", **used) as flight, aiohttp.ClientSession() as session:
            page, status = await a_page(session, flight), flight.cockpit.status
            page.pressed = ["KeyR"]
            await until(lambda: status().state == "recording")
            arm.steps[2] = 2048 + 300
            page.held = ["KeyE"]
            up, wanted = base(flight), 300 * 2 * np.pi / 4096
            await until(lambda: abs(joint(flight) - wanted) < 0.05)
            await until(lambda: base(flight) > up + 0.05)
            page.held = []
            page.hush()
            await until(lambda: status().dead)
            arm.steps[2] = 2048 - 300
            await asyncio.sleep(0.4)
            assert joint(flight) == pytest.approx(wanted, abs=0.1), "dead man"


def joint(flight: Flown) -> float:
    return float(flight.cockpit.obs["joint_pos"][0][1])


def base(flight: Flown) -> float:
    return float(flight.cockpit.obs["base_pos"][0][2])


def test_every_level_without_joints_refuses_a_leader_arm() -> None:
    bindings = shipped("keyboard", "leader_arm")
    for level in ("ee_pose", "ee_delta"):
        with pytest.raises(InvalidValueError, match="action=base_joint"):
            check_leader(level, bindings)
        check_leader(level, shipped("keyboard"))
    for level in ("base_joint", "velocity"):
        check_leader(level, bindings)


@pytest.mark.usefixtures("unhurried")
async def test_a_phones_poses_over_the_pages_socket_move_the_tool(tmp_path: Path) -> None:
    async with flown(tmp_path, devices=("keyboard", "phone")) as flight, aiohttp.ClientSession() as session:
        page, status = await a_page(session, flight), flight.cockpit.status
        upright = [0.0, 0.0, 0.0, 1.0]
        page.extra = {"pose": {"position": [0.4, 1.0, 0.2], "orientation": upright}}
        await until(lambda: not status().dead)
        page.held, page.pressed = ["phone:clutch"], ["phone:clutch"]
        await asyncio.sleep(0.3)
        assert status().speed == 0.0, "closing the clutch moves nothing"
        before = flight.cockpit.obs["ee_pos"][0].copy()
        for step in range(20):
            page.extra = {"pose": {"position": [0.4, 1.0 + 0.005 * step, 0.2], "orientation": upright}}
            await asyncio.sleep(0.03)
        await until(lambda: flight.cockpit.obs["ee_pos"][0][2] - before[2] == pytest.approx(0.095, abs=0.03))
        page.held = []
        page.extra = {"pose": {"position": [0.4, 0.5, 0.2], "orientation": upright}}
        await asyncio.sleep(0.3)
        assert flight.cockpit.obs["ee_pos"][0][2] - before[2] > 0.06, "an open clutch brings nothing back"
        page.hush()


async def test_a_page_that_falls_silent_with_a_key_held_hovers(tmp_path: Path) -> None:
    """After how many ticks is a test of the pilot's, after how many ms a target of the study of teleoperation."""
    async with flown(tmp_path) as flight, aiohttp.ClientSession() as session:
        page = await a_page(session, flight)
        page.held = ["KeyW"]
        await until(lambda: flight.cockpit.status().speed > 0.2)
        page.hush()
        await until(lambda: flight.cockpit.status().dead)
        assert flight.cockpit.status().speed == 0.0
