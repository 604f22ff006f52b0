"""The page in a real browser: a tutorial that keeps nothing, a review that can be looked through, keys of one's own."""

from __future__ import annotations

import asyncio
from functools import partial
from pathlib import Path

import aiohttp
import pytest

from aerial_il.core import presets
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.recording.reader import read_episode
from aerial_il.teleop.web.controls import Controls
from aerial_il.workflows.parts.sessions import summary
from tests.teleop.chromium import Tab, browser, needs_browser
from tests.teleop.flown import Flown, flown
from tests.teleop.page.test_page import in_state, together

pytestmark = [pytest.mark.browser, pytest.mark.render, needs_browser]
READY = "window.teleop && teleop.shown && teleop.status?.role === 'controller'"
TITLE = "document.getElementById('coach-title').textContent"


async def click(tab: Tab, name: str) -> None:
    await tab.value(f"document.getElementById('{name}').click(); 1")


async def scrub(tab: Tab, value: int) -> None:
    slider = "document.getElementById('scrub')"
    await tab.value(f"{slider}.value = {value}; {slider}.dispatchEvent(new Event('input')); 1")


def test_the_tutorial_waits_for_what_hands_do_and_keeps_nothing(tmp_path: Path) -> None:
    async def work() -> None:
        async with flown(tmp_path) as flight, browser() as opened:
            tab = await opened(flight.server.url)
            await tab.until(READY)
            await tab.until(f"{TITLE} === 'New here?'")
            await click(tab, "coach-begin")
            await tab.until("teleop.status.practice")
            assert "Press W and S" in await tab.value("document.getElementById('coach').innerText")
            await tab.hold("KeyE", 1.0)
            assert await tab.value(TITLE) == "Fly ahead and back", "another key is not the one that is asked for"
            for key, then in (("KeyW", "Up and down"), ("KeyE", "Turn"), ("ArrowLeft", "Change the mode")):
                await tab.key(key, down=True)
                await tab.until(f"{TITLE} === '{then}'")
                await tab.key(key, down=False)
            await tab.tap("Tab")
            if await tab.value("teleop.about.grips"):
                await tab.until(f"{TITLE} === 'Close and open the gripper'")
                await tab.hold("Space", 0.4)
            await tab.until(f"{TITLE} === 'Record'")
            await tab.tap("KeyR")
            await tab.until(f"{TITLE} === 'Fly a little, then stop'")
            await tab.hold("KeyW", 0.4)
            await tab.tap("KeyR")
            await tab.until(f"{TITLE} === 'Look at it, and keep it'")
            await tab.tap("Enter")
            await tab.until(f"{TITLE} === 'That is all'")
            await tab.until("!teleop.status.practice")
            assert await tab.value("localStorage.getItem('aerial_il.tutorial')") == "done"
            assert not tab.errors

    together(work())
    assert not list(tmp_path.rglob("*.mcap*")), "practice leaves no file"


def test_a_review_is_looked_through_and_shows_earlier_moments(tmp_path: Path) -> None:
    async def work() -> None:
        async with flown(tmp_path, summary=partial(summary, str(tmp_path))) as flight, browser() as opened:
            tab = await opened(flight.server.url)
            await tab.until(READY)
            await tab.tap("KeyR")
            await in_state(tab, "recording")
            await tab.hold("KeyE", 1.0)
            await tab.tap("KeyR")
            await in_state(tab, "review")
            await scrub(tab, 0)
            await asyncio.sleep(0.5)
            cockpit = flight.cockpit
            looked_at, now = cockpit.looked_at, flight.env.get_state()[0]
            assert looked_at is not None
            assert abs(looked_at[1:4] - now[1:4]).max() > 0.1, "the vehicle has moved since"
            before = await tab.value("document.getElementById('canvas-0').toDataURL()")
            await scrub(tab, 1000)
            await tab.until(f"document.getElementById('canvas-0').toDataURL() !== {before!r}")
            assert "of 0:0" in await tab.value("document.getElementById('scrub-time').textContent")
            await tab.tap("Enter")
            await tab.until("teleop.status.counts.failures === 1")
            text = await summary_of(flight)
            assert "1 flights by hand" in text
            assert "data:image/jpeg" in text
            assert not tab.errors

    together(work())


def test_keys_are_changed_on_the_page_and_a_conflict_is_told(tmp_path: Path) -> None:
    controls = Controls(partial(presets.read, "device"), ("keyboard", "gamepad", "touch"), tmp_path / "controls")

    async def work() -> None:
        async with flown(tmp_path / "out", controls=controls) as flight, browser() as opened:
            tab = await opened(flight.server.url)
            await tab.until(READY)
            await click(tab, "controls-button")
            await tab.value("document.querySelector('[data-of=\"keyboard record\"]').click(); 1")
            await tab.tap("KeyW")
            notice = "document.getElementById('controls-notice').textContent"
            assert "gives “ahead” already" in await tab.value(notice)
            await tab.tap("KeyG")
            await click(tab, "controls-save")
            await tab.until(f"{notice}.startsWith('Saved')")
            await tab.value("document.getElementById('controls').close(); 1")
            await tab.tap("KeyR")
            await tab.tap("KeyG")
            await in_state(tab, "recording")
            await tab.hold("KeyW", 0.3)
            await tab.tap("KeyG")
            await in_state(tab, "review")
            await tab.tap("Enter")
            await tab.until("teleop.status.counts.failures === 1")
            assert not tab.errors

    together(work())
    (file,) = DatasetFolder(tmp_path / "out").files("failures")
    assert dict(read_episode(file).provenance["settings"]["bindings"]["keys"])["KeyG"] == "record"
    assert "KeyG" in (tmp_path / "controls" / "keyboard.yaml").read_text()


def test_the_page_says_which_mode_is_on_how_long_success_holds_and_what_came_too_early(tmp_path: Path) -> None:
    async def work() -> None:
        async with flown(tmp_path) as flight, browser() as opened:
            tab = await opened(flight.server.url)
            await tab.until(READY)
            assert await tab.value("document.getElementById('mode').hidden && document.getElementById('hold').hidden")
            await tab.tap("Tab")
            await tab.until("document.getElementById('mode').textContent === 'base mode'")
            assert not await tab.value("document.getElementById('mode').hidden")
            await tab.value("teleop.socket.close(); 1")
            await tab.until("!teleop.status")
            await tab.tap("KeyR")
            await tab.until(f"{READY} && document.getElementById('banner').innerText.includes('R” came too early')")
            assert await tab.value("teleop.status.state") == "idle", "what is said to be lost is lost"
            flight.cockpit._share_held = lambda: 0.5
            await tab.until("document.getElementById('hold').getAttribute('aria-valuenow') === '50'")
            assert not tab.errors

    together(work())


async def summary_of(flight: Flown) -> str:
    """Return the session's summary as the page's link gets it, which asks for the token."""
    url = f"http://127.0.0.1:{flight.server.port}/summary"
    async with aiohttp.ClientSession() as session:
        async with session.get(url) as refused:
            assert refused.status == 403
        async with session.get(f"{url}?token={flight.server.token}") as answer:
            assert answer.status == 200, await answer.text()
            return await answer.text()
