"""Tasks flown end to end by who sees only what the page shows and only presses its keys, or moves a gamepad."""

from contextlib import asynccontextmanager
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from aerial_il.data.folder import DatasetFolder
from aerial_il.data.recording.reader import read_episode
from aerial_il.data.replay import replay
from aerial_il.teleop.session.refly import refly
from tests.teleop.chromium import needs_browser
from tests.teleop.flown import browsed
from tests.teleop.hands import world
from tests.teleop.page_reader import KeyHands, PadHands, PageReader, read_number
from tests.teleop.plans import PLANS, Reach

ATTEMPTS, LIMIT_S = 3, 60.0
HANDS = (KeyHands, PadHands)


@pytest.mark.parametrize(
    ("text", "number"),
    [("ahead 12.3", 12.3), ("back 34.6", -34.6), ("nose up 46°", -46.0), ("roll right 7°", 7.0), ("open 100%", 100.0),
     ("0.0", 0.0), ("-3.5", -3.5)],
)  # fmt: skip
def test_a_number_on_the_page_is_read_with_its_word(text: str, number: float) -> None:
    assert read_number(text) == number


def marked(test: Any) -> Any:
    """Mark a test at a real page, in which a busy machine makes nobody seem to be gone."""
    for mark in (pytest.mark.browser, pytest.mark.render, needs_browser, pytest.mark.usefixtures("unhurried")):
        test = mark(test)
    return test


@asynccontextmanager
async def somebody_at(out: Path, hands: type[KeyHands | PadHands] = KeyHands, **settings: Any):
    """Yield somebody with such hands at the page of a flight."""
    async with browsed(out, **settings) as (_, tab):
        person = PageReader(tab, hands(tab))
        if isinstance(person.hands, PadHands):
            await person.hands.plug_in()
        yield person


@marked
async def test_reach_is_solved_with_keys_by_what_the_page_shows(tmp_path: Path) -> None:
    await fly_once(tmp_path, "reach", KeyHands)
    recordings_hold(tmp_path, "reach", solved=1)


@marked
@pytest.mark.slow
@pytest.mark.parametrize(("task", "hands"), [each for each in product(PLANS, HANDS) if each != ("reach", KeyHands)])
async def test_tasks_are_solved_with_keys_and_with_a_gamepad(
    tmp_path: Path, task: str, hands: type[KeyHands | PadHands]
) -> None:
    await fly_once(tmp_path, task, hands)
    recordings_hold(tmp_path, task, solved=1)


@marked
async def test_who_cannot_see_the_numbers_cannot_fly_by_them(tmp_path: Path) -> None:
    """With the numbers folded away the same driver is lost at its first look: it has no other source."""
    async with somebody_at(tmp_path) as person:
        await person.until(lambda s: "tool to target, cm" in s.numbers)
        await person.tab.tap("KeyN")
        await person.until(lambda s: not s.numbers)
        await person.record()
        with pytest.raises(KeyError, match="tool to target"):
            await person.fly(Reach(), LIMIT_S)


async def fly_once(out: Path, task: str, hands: type[KeyHands | PadHands]) -> None:
    """Fly a task until it is solved, as a person does: what has failed is kept as a failure, three at most."""
    async with somebody_at(out, hands, task=task) as person:
        for _ in range(ATTEMPTS):
            await person.record()
            solved = await person.fly(PLANS[task](), LIMIT_S)
            await person.keep()
            if solved:
                return
        raise AssertionError(f"{task} was not solved in {ATTEMPTS} flights; the page shows {person.sight}")


def recordings_hold(out: Path, task: str, *, solved: int) -> None:
    """Require that everything replays by its actions and by its log, and that as much as was said was solved."""
    env, folder = world(task=task), DatasetFolder(out)
    for file in [*folder.files(), *folder.files("failures")]:
        episode = read_episode(file)
        assert replay(env, episode) == refly(env, episode) == len(episode)
    assert len(folder.files()) == solved
    assert all(read_episode(file).success for file in folder.files())
    env.close()
