"""The page in a real browser: real keys, a mocked gamepad, a real dataset."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path

import pytest

from aerial_il.data.folder import DatasetFolder
from aerial_il.data.recording.reader import read_episode
from aerial_il.data.replay import replay
from aerial_il.teleop.session.refly import refly
from tests.teleop.chromium import Tab, browser, needs_browser
from tests.teleop.flown import flown
from tests.teleop.hands import world
from tests.teleop.narrow import narrowed

pytestmark = [pytest.mark.browser, pytest.mark.render, needs_browser]
STATE = "document.body.dataset.state"
GAMEPAD = """
window.mock = {axes: [0, 0, 0, 0], buttons: Array.from({length: 17}, () => ({pressed: false, value: 0})),
               connected: true, mapping: "standard", id: "mock", index: 0};
navigator.getGamepads = () => [window.mock];
"""


def together(work) -> None:
    asyncio.run(asyncio.wait_for(work, 120.0))


async def in_state(tab: Tab, state: str) -> None:
    await tab.until(f"{STATE} === '{state}'")


def test_with_real_keys_an_episode_is_flown_kept_discarded_and_brought_back(tmp_path: Path) -> None:
    async def work() -> None:
        async with flown(tmp_path) as flight, browser() as opened:
            tab = await opened(flight.server.url)
            await tab.until("window.teleop && teleop.shown && teleop.status?.role === 'controller'")
            await tab.until("document.getElementById('banner').hidden")
            assert await tab.value("document.getElementById('task').textContent") == "reach"
            before = flight.env.observe()["ee_pos"][0].copy()
            await asyncio.sleep(0.5)
            assert abs(flight.env.observe()["ee_pos"][0] - before).max() < 0.02, "it hovers"
            await tab.tap("KeyR")
            await in_state(tab, "recording")
            await tab.hold("KeyW", 0.8)
            await tab.hold("KeyQ", 0.4)
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
            await tab.hold("KeyA", 0.4)
            await tab.tap("Backspace")
            await tab.until("teleop.status.counts.trash === 1")
            await tab.tap("KeyU")
            await tab.until("teleop.status.counts.trash === 0 && teleop.status.counts.failures === 2")
            assert await tab.value("teleop.latencies.length") >= 4
            assert not tab.errors

    together(work())
    env = world()
    files = DatasetFolder(tmp_path).files("failures")
    assert len(files) == 2
    for file in files:
        episode = read_episode(file)
        assert replay(env, episode) == refly(env, episode) == len(episode)
    moved = [abs(read_episode(file).actions[:, :3] - read_episode(file).actions[0, :3]).max() for file in files]
    assert min(moved) > 0.05, "the keys were flown"


def test_a_gamepad_flies_and_one_that_is_unplugged_hovers(tmp_path: Path) -> None:
    async def work() -> None:
        async with flown(tmp_path) as flight, browser() as opened:
            tab = await opened(flight.server.url)
            await tab.until("window.teleop && teleop.status?.role === 'controller'")
            await tab.value(GAMEPAD + "window.mock.axes[3] = -1; 1")
            await tab.until("teleop.status.speed > 0.35")
            assert await tab.value("document.body.dataset.device") == "gamepad"
            await tab.value("window.mock.connected = false; 1")
            await tab.until("teleop.status.speed === 0")
            assert "Gamepad unplugged" in await tab.value("document.getElementById('banner').innerText")
            await tab.value("window.mock.connected = true; window.mock.axes[3] = 0; 1")
            await tab.value("window.mock.buttons[9] = {pressed: true, value: 1}; 1")
            await in_state(tab, "recording")
            assert not tab.errors

    together(work())


def test_another_window_in_front_shows_a_red_banner_and_pauses_a_recording(tmp_path: Path) -> None:
    async def work() -> None:
        async with flown(tmp_path) as flight, browser() as opened:
            tab = await opened(flight.server.url)
            await tab.until("window.teleop && teleop.status?.role === 'controller'")
            await tab.tap("KeyR")
            await in_state(tab, "recording")
            await tab.key("KeyW", down=True)
            await tab.until("teleop.status.speed > 0.3")
            await tab.value("dispatchEvent(new Event('blur')); 1")
            await tab.until("!document.getElementById('banner').hidden")
            await tab.until("teleop.status.speed === 0 && teleop.status.dead")
            await in_state(tab, "paused")
            assert "Hands off" in await tab.value("document.getElementById('banner').innerText")

    together(work())


def test_keys_with_ctrl_belong_to_the_browser_and_help_takes_none(tmp_path: Path) -> None:
    async def work() -> None:
        async with flown(tmp_path) as flight, browser() as opened:
            tab = await opened(flight.server.url)
            await tab.until("window.teleop && teleop.status?.role === 'controller'")
            ctrl = {"type": "rawKeyDown", "code": "KeyR", "key": "r", "windowsVirtualKeyCode": 82, "modifiers": 2}
            await tab.value("addEventListener('keydown', (e) => { if (e.ctrlKey) e.preventDefault(); }); 1")
            await tab.call("Input.dispatchKeyEvent", **ctrl)
            await tab.tap("KeyH")
            await tab.until("document.getElementById('help').open")
            await tab.tap("KeyR")
            await asyncio.sleep(0.5)
            assert await tab.value(STATE) == "idle"
            assert "turn left" in await tab.value("document.getElementById('help').innerText")

    together(work())


def test_over_a_narrow_link_pictures_stay_young(tmp_path: Path) -> None:
    """60 kB/s and 40 ms each way: pictures become smaller, and those that would only grow old are not sent."""

    async def work() -> list[float]:
        async with (
            flown(tmp_path, size=(360, 480)) as flight,
            narrowed(flight.server.port, bytes_per_s=60e3, delay_s=0.04) as port,
            browser() as opened,
        ):
            tab = await opened(f"http://127.0.0.1:{port}/?token={flight.server.token}")
            await tab.until("window.teleop && teleop.shown && teleop.offset !== null")
            await asyncio.sleep(4.0)
            ages = "setInterval(() => ages.push(performance.now() + teleop.offset - 1000 * teleop.shown.taken), 50)"
            await tab.value(f"window.ages = []; {ages}")
            await asyncio.sleep(5.0)
            return await tab.value("ages")

    found = sorted(asyncio.run(asyncio.wait_for(work(), 120.0)))
    assert len(found) > 50
    assert found[len(found) // 2] < 500.0
    print(
        f"age over a narrow link: median {found[len(found) // 2]:.0f} ms, 95 % {found[int(0.95 * len(found))]:.0f} ms"
    )


def test_a_finger_on_the_page_flies_and_records(tmp_path: Path) -> None:
    async def work() -> None:
        async with flown(tmp_path) as flight, browser() as opened:
            tab = await opened(flight.server.url)
            await tab.look(width=390, height=844, phone=True)
            await tab.until("window.teleop && teleop.shown && teleop.status?.role === 'controller'")
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
            assert not tab.errors

    together(work())


def test_a_phone_that_is_turned_in_the_hand_turns_the_tool_while_its_clutch_is_held(tmp_path: Path) -> None:
    """Its orientation sensor is the browser's own, told what to show."""

    async def work() -> None:
        async with flown(tmp_path, devices=("keyboard", "touch", "phone")) as flight, browser() as opened:
            tab = await opened(flight.server.url)
            await tab.look(width=390, height=844, phone=True)
            await tab.until("window.teleop && teleop.shown && teleop.status?.role === 'controller'")
            await tab.call("DeviceOrientation.setDeviceOrientationOverride", alpha=10, beta=30, gamma=0)
            await tab.value("document.getElementById('phone-start').click(); 1")
            await tab.until("!document.getElementById('phone-clutch').hidden")
            x, y = await middle(tab, "#phone-clutch")
            await tab.touch("touchStart", x, y)
            await asyncio.sleep(0.5)
            before = flight.env.observe()["base_rot6d"][0].copy()
            await tab.call("DeviceOrientation.setDeviceOrientationOverride", alpha=45, beta=30, gamma=0)
            await asyncio.sleep(2.0)
            after = flight.env.observe()["base_rot6d"][0]
            turned = math.atan2(after[1], after[0]) - math.atan2(before[1], before[0])
            assert turned == pytest.approx(math.radians(35), abs=0.15)
            await tab.touch("touchEnd")
            assert not tab.errors

    together(work())


async def middle(tab: Tab, selector: str) -> tuple[float, float]:
    """Return where the middle of an element is on the page."""
    box = f"document.querySelector('{selector}').getBoundingClientRect()"
    return await tab.value(f"(() => {{ const b = {box}; return [b.x + b.width / 2, b.y + b.height / 2]; }})()")
