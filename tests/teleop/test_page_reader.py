"""Tasks flown end to end by who sees only what the page shows and only presses its keys, or moves a gamepad."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from aerial_il.data.folder import DatasetFolder
from aerial_il.data.recording.reader import read_episode
from aerial_il.data.replay import replay
from aerial_il.teleop.session.refly import refly
from tests.teleop.chromium import browser, needs_browser
from tests.teleop.flown import flown
from tests.teleop.hands import world
from tests.teleop.page_reader import KeyHands, PadHands, PageReader, read_number
from tests.teleop.plans import PLANS, Reach
from tests.teleop.sessions import discarded_and_brought_back, kept, recorded_again, rescued

ATTEMPTS, LIMIT_S = 3, 60.0


@pytest.mark.parametrize(
    ("text", "number"),
    [("ahead 12.3", 12.3), ("back 34.6", -34.6), ("nose up 46°", -46.0), ("roll right 7°", 7.0), ("open 100%", 100.0),
     ("0.0", 0.0), ("-3.5", -3.5)],
)  # fmt: skip
def test_a_number_on_the_page_is_read_with_its_word(text: str, number: float) -> None:
    assert read_number(text) == number


@pytest.mark.browser
@pytest.mark.render
@needs_browser
def test_reach_is_solved_with_keys_by_what_the_page_shows(tmp_path: Path) -> None:
    fly_once(tmp_path, "reach", "keys")
    recordings_hold(tmp_path, "reach", solved=1)


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.render
@needs_browser
@pytest.mark.parametrize(
    ("task", "hands"),
    [
        ("reach", "pad"),
        ("pick_place", "keys"),
        ("pick_place", "pad"),
        ("press_button", "keys"),
        ("press_button", "pad"),
    ],
)
def test_tasks_are_solved_with_keys_and_with_a_gamepad(tmp_path: Path, task: str, hands: str) -> None:
    fly_once(tmp_path, task, hands)
    recordings_hold(tmp_path, task, solved=1)


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.render
@needs_browser
def test_a_session_of_keeping_discarding_and_recording_again(tmp_path: Path) -> None:
    async def work() -> None:
        async with flown(tmp_path) as flight, browser() as opened:
            tab = await opened(flight.server.url)
            await tab.look(width=1280, height=720)
            person = PageReader(tab, KeyHands(tab))
            for part in (kept, discarded_and_brought_back, recorded_again):
                await part(person)
            assert person.sight.counts == (2, 1, 1)
            assert not tab.errors

    asyncio.run(asyncio.wait_for(work(), 300.0))
    recordings_hold(tmp_path, "reach", solved=2)


class Stray:
    """A policy that leads the tool away, up and aside."""

    def act(self, obs: Mapping[str, np.ndarray]) -> np.ndarray:
        astray = obs["ee_pos"] + [0.0, 0.0, 0.02]
        return np.concatenate([astray, obs["ee_rot6d"], np.ones((len(astray), 1))], axis=-1)

    def reset(self, mask: np.ndarray | None = None) -> None:
        pass


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.render
@needs_browser
@pytest.mark.parametrize("hands", [KeyHands, PadHands])
def test_a_flight_that_a_policy_leads_astray_is_rescued(tmp_path: Path, hands: type[KeyHands | PadHands]) -> None:
    async def work() -> None:
        async with flown(tmp_path, policy=Stray()) as flight, browser() as opened:
            tab = await opened(flight.server.url)
            await tab.look(width=1280, height=720)
            person = PageReader(tab, hands(tab))
            if isinstance(person.hands, PadHands):
                await person.hands.plug_in()
            await rescued(person)

    asyncio.run(asyncio.wait_for(work(), 200.0))
    recordings_hold(tmp_path, "reach", solved=1)
    (file,) = DatasetFolder(tmp_path).files()
    held = read_episode(file).is_intervention
    assert 0 < held.sum() < len(held), "the policy flew first"


@pytest.mark.browser
@pytest.mark.render
@needs_browser
def test_who_cannot_see_the_numbers_cannot_fly_by_them(tmp_path: Path) -> None:
    """With the numbers folded away the same driver is lost at its first look: it has no other source."""

    async def work() -> None:
        async with flown(tmp_path) as flight, browser() as opened:
            tab = await opened(flight.server.url)
            await tab.look(width=1280, height=720)
            person = PageReader(tab, KeyHands(tab))
            await person.until(lambda s: "tool to target, cm" in s.numbers)
            await tab.tap("KeyN")
            await person.until(lambda s: not s.numbers)
            await person.record()
            with pytest.raises(KeyError, match="tool to target"):
                await person.fly(Reach(), 5.0)

    asyncio.run(asyncio.wait_for(work(), 120.0))


def fly_once(out: Path, task: str, hands: str) -> None:
    """Fly a task until it is solved, as a person does: what has failed is kept as a failure, three at most."""

    async def work() -> None:
        async with flown(out, task=task) as flight, browser() as opened:
            tab = await opened(flight.server.url)
            await tab.look(width=1280, height=720)
            person = PageReader(tab, KeyHands(tab) if hands == "keys" else PadHands(tab))
            if isinstance(person.hands, PadHands):
                await person.hands.plug_in()
            for _ in range(ATTEMPTS):
                await person.record()
                solved = await person.fly(PLANS[task](), LIMIT_S)
                await person.keep()
                if solved:
                    return
            raise AssertionError(f"{task} was not solved in {ATTEMPTS} flights; the page shows {person.sight}")

    asyncio.run(asyncio.wait_for(work(), 300.0))


def recordings_hold(out: Path, task: str, *, solved: int) -> None:
    """Require that everything replays by its actions and by its log, and that as much as was said was solved."""
    env, folder = world(task=task), DatasetFolder(out)
    for file in [*folder.files(), *folder.files("failures")]:
        episode = read_episode(file)
        assert replay(env, episode) == refly(env, episode) == len(episode)
    assert len(folder.files()) == solved
    assert all(read_episode(file).success for file in folder.files())
    env.close()
