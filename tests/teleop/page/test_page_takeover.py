"""Taking over on the page, in a real browser with real keys: what is seen, what is said, and what is recorded."""

from __future__ import annotations

from pathlib import Path

import pytest

import aerial_il
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.recording.reader import read_episode
from aerial_il.data.replay import replay
from aerial_il.teleop.session.refly import refly
from tests.teleop.chromium import needs_browser
from tests.teleop.flown import browsed
from tests.teleop.hands import world
from tests.teleop.page.test_page import hold_until, in_state

pytestmark = [pytest.mark.browser, pytest.mark.render, needs_browser]
FRAME = "getComputedStyle(document.querySelector('.stage')).boxShadow"


@pytest.mark.usefixtures("unhurried")
async def test_the_frame_is_blue_for_a_policy_orange_for_a_person(tmp_path: Path) -> None:
    expert = aerial_il.expert("fa_hexa_arm4", "pick_place")
    async with browsed(tmp_path, policy=expert, task="pick_place") as (flight, tab):
        await tab.until("document.body.dataset.flier === 'policy'")
        assert "hold to take over" in await tab.value("document.getElementById('hints').innerText")
        await tab.look(width=1200, height=700, dark=True)
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
