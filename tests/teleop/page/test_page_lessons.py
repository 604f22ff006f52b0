"""The page in a real browser: tutorial, review, keys of one's own, and taking over from a policy."""

from functools import partial
from pathlib import Path

import aiohttp
import pytest

import aerial_il
from aerial_il.core import presets
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.recording.reader import read_episode
from aerial_il.data.replay import replay
from aerial_il.teleop.session.attempt import Attempt
from aerial_il.teleop.session.refly import refly
from aerial_il.teleop.web.controls import Controls
from aerial_il.workflows.parts.sessions import summary
from tests.patience import until
from tests.teleop.chromium import Tab, needs_browser
from tests.teleop.flown import READY, Flown, browsed
from tests.teleop.hands import world
from tests.teleop.page.test_page import hold_until, in_state, went

pytestmark = [pytest.mark.browser, pytest.mark.render, needs_browser]
TITLE = "document.getElementById('coach-title').textContent"


async def click(tab: Tab, name: str) -> None:
    await tab.value(f"document.getElementById('{name}').click(); 1")


async def scrub(tab: Tab, value: int) -> None:
    slider = "document.getElementById('scrub')"
    await tab.value(f"{slider}.value = {value}; {slider}.dispatchEvent(new Event('input')); 1")


@pytest.mark.usefixtures("unhurried")
async def test_the_tutorial_waits_for_what_hands_do_and_keeps_nothing(tmp_path: Path) -> None:
    async with browsed(tmp_path) as (_, tab):
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
    assert not list(tmp_path.rglob("*.mcap*")), "practice leaves no file"


@pytest.mark.usefixtures("unhurried")
async def test_a_review_shows_earlier_moments(tmp_path: Path) -> None:
    async with browsed(tmp_path, summary=partial(summary, str(tmp_path))) as (flight, tab):
        await tab.tap("KeyR")
        await in_state(tab, "recording")
        await hold_until(tab, "KeyE", went(flight, 0.2))
        await tab.tap("KeyR")
        await in_state(tab, "review")
        await scrub(tab, 0)
        cockpit = flight.cockpit
        await until(lambda: cockpit.looked_at is not None)
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


@pytest.mark.usefixtures("unhurried")
async def test_keys_are_changed_on_the_page(tmp_path: Path) -> None:
    controls = Controls(partial(presets.read, "device"), ("keyboard", "gamepad", "touch"), tmp_path / "controls")
    async with browsed(tmp_path / "out", controls=controls) as (_, tab):
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
    (file,) = DatasetFolder(tmp_path / "out").files("failures")
    assert dict(read_episode(file).provenance["settings"]["bindings"]["keys"])["KeyG"] == "record"
    assert "KeyG" in (tmp_path / "controls" / "keyboard.yaml").read_text()


async def test_the_page_says_mode_hold_and_what_came_too_early(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async with browsed(tmp_path) as (_, tab):
        assert await tab.value("document.getElementById('mode').hidden && document.getElementById('hold').hidden")
        await tab.tap("Tab")
        await tab.until("document.getElementById('mode').textContent === 'base mode'")
        assert not await tab.value("document.getElementById('mode').hidden")
        await tab.value("teleop.socket.close(); 1")
        await tab.until("!teleop.status")
        await tab.tap("KeyR")
        await tab.until(f"{READY} && document.getElementById('banner').innerText.includes('R” came too early')")
        assert await tab.value("teleop.status.state") == "idle", "what is said to be lost is lost"
        monkeypatch.setattr(Attempt, "share_held", lambda _: 0.5)
        await tab.until("document.getElementById('hold').getAttribute('aria-valuenow') === '50'")


async def summary_of(flight: Flown) -> str:
    """Return the session's summary as the page's link gets it, which asks for the token."""
    url = f"http://127.0.0.1:{flight.server.port}/summary"
    async with aiohttp.ClientSession() as session:
        async with session.get(url) as refused:
            assert refused.status == 403
        async with session.get(f"{url}?token={flight.server.token}") as answer:
            assert answer.status == 200, await answer.text()
            return await answer.text()


FRAME = "getComputedStyle(document.querySelector('.stage')).boxShadow"


@pytest.mark.usefixtures("unhurried")
async def test_the_frame_is_blue_for_a_policy_orange_for_a_person(tmp_path: Path) -> None:
    expert = aerial_il.expert("fa_hexa_arm4", "pick_place")
    async with browsed(tmp_path, policy=expert, task="pick_place") as (flight, tab):
        await tab.until("document.body.dataset.flier === 'policy'")
        assert "hold to take over" in await tab.value("document.getElementById('hints').innerText")
        await tab.until(f"{FRAME}.includes('77, 141, 255')")
        await tab.tap("KeyR")
        await in_state(tab, "recording")
        await tab.key("KeyT", down=True)
        await tab.until("document.body.dataset.flier === 'person'")
        await tab.until(f"{FRAME}.includes('242, 139, 60')")
        assert await tab.value("document.getElementById('live-flier').textContent") == "You fly"
        assert await tab.value("document.getElementById('live-flier').ariaLive") == "assertive"
        before = flight.cockpit.status().person_steps
        await hold_until(tab, "KeyE", lambda: flight.cockpit.status().person_steps > before + 15)
        await tab.key("KeyT", down=False)
        await tab.until("document.body.dataset.flier === 'policy'")
        await tab.tap("KeyR")
        await in_state(tab, "review")
        await tab.tap("Enter")
        await in_state(tab, "idle")
    folder = DatasetFolder(tmp_path)
    (file,) = [*folder.files("failures"), *folder.files()]
    episode, env = read_episode(file), world(task="pick_place")
    held = episode.is_intervention
    assert 10 < held.sum() < len(episode)
    assert not held[0], "the policy began"
    assert replay(env, episode) == refly(env, episode) == len(episode)
