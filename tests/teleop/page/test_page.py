"""The page in a real browser: real keys, a mocked gamepad, a real dataset."""

import asyncio
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from aerial_il.data.folder import DatasetFolder
from aerial_il.data.recording.reader import read_episode
from aerial_il.data.replay import replay
from aerial_il.teleop.session.refly import refly
from aerial_il.teleop.web.visitors import MAX_UNSEEN
from experiments.teleop.narrow import narrowed
from tests.patience import until
from tests.teleop.chromium import Tab, browser, needs_browser
from tests.teleop.flown import Flown, browsed, flown
from tests.teleop.hands import world
from tests.teleop.page_reader import PAD

pytestmark = [pytest.mark.browser, pytest.mark.render, needs_browser]
UPRIGHT = (390, 844)
STATE = "document.body.dataset.state"


async def hold_until(tab: Tab, key: str, seen: Callable[[], object]) -> None:
    """Hold a key until something has come of it, however slow the machine is."""
    await tab.key(key, down=True)
    await until(seen)
    await tab.key(key, down=False)


def tool(flight: Flown) -> np.ndarray:
    return flight.cockpit.obs["ee_pos"][0].copy()


def went(flight: Flown, metres: float = 0.1) -> Callable[[], bool]:
    """Return what says whether the tool is so far from where it is now."""
    start = tool(flight)
    return lambda: bool(abs(tool(flight) - start).max() > metres)


async def in_state(tab: Tab, state: str) -> None:
    await tab.until(f"{STATE} === '{state}'")


@pytest.mark.usefixtures("unhurried")
async def test_keys_fly_an_episode_kept_and_one_brought_back(tmp_path: Path) -> None:
    async with browsed(tmp_path) as (flight, tab):
        await tab.until("document.getElementById('banner').hidden")
        assert await tab.value("document.getElementById('task').textContent") == "reach"
        moved, ticks = went(flight, 0.02), flight.cockpit.tick_count
        await until(lambda: flight.cockpit.tick_count > ticks + 25)
        assert not moved(), "it hovers"
        await tab.tap("KeyR")
        await in_state(tab, "recording")
        await hold_until(tab, "KeyW", went(flight))
        await hold_until(tab, "KeyQ", went(flight))
        await tab.tap("Tab")
        await tab.until("teleop.status.mode === 'base'")
        await tab.tap("KeyR")
        await in_state(tab, "review")
        assert "Not solved" in await tab.value("document.getElementById('review').innerText")
        await tab.tap("Enter")
        await tab.until("teleop.status.counts.failures === 1")
        await in_state(tab, "idle")
        await tab.tap("KeyR")
        await in_state(tab, "recording")
        await hold_until(tab, "KeyA", went(flight))
        await tab.tap("Backspace")
        await tab.until("teleop.status.counts.trash === 1")
        await tab.tap("KeyU")
        await tab.until("teleop.status.counts.trash === 0 && teleop.status.counts.failures === 2")
        assert await tab.value("teleop.latencies.length") >= 4
    env = world()
    files = DatasetFolder(tmp_path).files("failures")
    assert len(files) == 2
    for file in files:
        episode = read_episode(file)
        assert replay(env, episode) == refly(env, episode) == len(episode)
    moved = [abs(read_episode(file).actions[:, :3] - read_episode(file).actions[0, :3]).max() for file in files]
    assert min(moved) > 0.05, "the keys were flown"


async def test_a_gamepad_flies_and_one_that_is_unplugged_hovers(tmp_path: Path) -> None:
    async with browsed(tmp_path) as (_, tab):
        await tab.value(PAD + "window.mock.axes[3] = -1; 1")
        await tab.until("teleop.status.speed > 0.35")
        assert await tab.value("document.body.dataset.device") == "gamepad"
        await tab.value("window.mock.connected = false; 1")
        await tab.until("teleop.status.speed === 0")
        assert "Gamepad unplugged" in await tab.value("document.getElementById('banner').innerText")
        await tab.value("window.mock.connected = true; window.mock.axes[3] = 0; 1")
        await tab.value("window.mock.buttons[9] = {pressed: true, value: 1}; 1")
        await in_state(tab, "recording")


async def test_another_window_in_front_pauses_a_recording(tmp_path: Path) -> None:
    async with browsed(tmp_path) as (_, tab):
        await tab.tap("KeyR")
        await in_state(tab, "recording")
        await tab.key("KeyW", down=True)
        await tab.until("teleop.status.speed > 0.3")
        await tab.value("dispatchEvent(new Event('blur')); 1")
        await tab.until("!document.getElementById('banner').hidden")
        await tab.until("teleop.status.speed === 0 && teleop.status.dead")
        await in_state(tab, "paused")
        assert "Hands off" in await tab.value("document.getElementById('banner').innerText")


async def test_keys_with_ctrl_or_help_open_fly_nothing(tmp_path: Path) -> None:
    async with browsed(tmp_path) as (_, tab):
        ctrl = {"type": "rawKeyDown", "code": "KeyR", "key": "r", "windowsVirtualKeyCode": 82, "modifiers": 2}
        await tab.value("addEventListener('keydown', (e) => { if (e.ctrlKey) e.preventDefault(); }); 1")
        await tab.call("Input.dispatchKeyEvent", **ctrl)
        await tab.tap("KeyH")
        await tab.until("document.getElementById('help').open")
        await tab.tap("KeyR")
        await tab.value(PAD + "window.mock.axes[3] = -1; window.mock.buttons[9] = {pressed: true, value: 1}; 1")
        await asyncio.sleep(0.5)
        assert await tab.value(STATE) == "idle"
        assert await tab.value("teleop.status.speed") == 0
        assert "turn left" in await tab.value("document.getElementById('help').innerText")


async def test_over_a_narrow_link_pictures_become_smaller(tmp_path: Path) -> None:
    """60 kB/s and 40 ms each way; how old they are then is measured by the study of teleoperation."""
    async with (
        flown(tmp_path, size=(360, 480)) as flight,
        narrowed(flight.server.port, bytes_per_s=60e3, delay_s=0.04) as port,
        browser() as opened,
    ):
        tab = await opened(f"http://127.0.0.1:{port}/?token={flight.server.token}")
        await tab.until("window.teleop && teleop.shown && teleop.offset !== null")
        visitor = flight.server.visitors.controller
        assert visitor is not None
        await until(lambda: visitor.link.thrift > 0)
        shown = await tab.value("teleop.shown.number")
        await tab.until(f"teleop.shown.number > {shown}")
        assert len(visitor.on_way) <= MAX_UNSEEN


async def test_a_finger_on_the_page_flies_and_records(tmp_path: Path) -> None:
    async with browsed(tmp_path, UPRIGHT, phone=True) as (_, tab):
        x, y = await middle(tab, "#stick-right")
        await tab.touch("touchStart", x, y)
        await tab.touch("touchMove", x, y - 60)
        await tab.until("teleop.status.speed > 0.35")
        assert await tab.value("document.body.dataset.device") == "touch"
        await tab.touch("touchEnd")
        await tab.until("teleop.status.speed === 0")
        x, y = await middle(tab, '#pads [data-command="record"]:not([hidden])')
        await tab.touch("touchStart", x, y)
        await tab.touch("touchEnd")
        await in_state(tab, "recording")


@pytest.mark.usefixtures("unhurried")
async def test_a_phone_turned_in_the_hand_turns_the_tool(tmp_path: Path) -> None:
    """Its orientation sensor is the browser's own, made to show it."""
    async with browsed(tmp_path, UPRIGHT, phone=True, devices=("keyboard", "touch", "phone")) as (flight, tab):
        await tab.call("DeviceOrientation.setDeviceOrientationOverride", alpha=10, beta=30, gamma=0)
        await tab.value("document.getElementById('phone-start').click(); 1")
        await tab.until("!document.getElementById('phone-clutch').hidden")
        x, y = await middle(tab, "#phone-clutch")
        await tab.touch("touchStart", x, y)
        await asyncio.sleep(0.5)
        start = heading(flight.cockpit.obs["base_rot6d"][0])
        await tab.call("DeviceOrientation.setDeviceOrientationOverride", alpha=45, beta=30, gamma=0)
        wanted = start + math.radians(35)
        await until(lambda: abs(heading(flight.cockpit.obs["base_rot6d"][0]) - wanted) < 0.15)
        await tab.touch("touchEnd")


def heading(rot6d: np.ndarray) -> float:
    return math.atan2(rot6d[1], rot6d[0])


async def middle(tab: Tab, selector: str) -> tuple[float, float]:
    """Return where the middle of an element is on the page."""
    box = f"document.querySelector('{selector}').getBoundingClientRect()"
    return await tab.value(f"(() => {{ const b = {box}; return [b.x + b.width / 2, b.y + b.height / 2]; }})()")
