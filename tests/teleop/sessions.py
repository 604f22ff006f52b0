"""Parts of a session with somebody at the page, each checked by what the page then shows."""

import asyncio

from tests.teleop.page_reader import PageReader, Sight, Wish
from tests.teleop.plans import Reach

SOLVING_S, WATCHING_S = 60.0, 3.0


def onwards(_: Sight) -> Wish:
    """Fly ahead, wherever that leads."""
    return Wish({"forward": (50.0, 0.0)})


async def kept(person: PageReader) -> None:
    """Solve ``reach`` and keep it."""
    saved, *_ = (await person.until(lambda s: s.state == "free flight")).counts
    await person.record()
    assert await person.fly(Reach(), SOLVING_S), f"not solved: {person.sight}"
    await person.keep()
    await person.until(lambda s: s.counts[0] == saved + 1)


async def discarded_and_brought_back(person: PageReader) -> None:
    """Throw a flight away in mid-air, and have second thoughts."""
    before = (await person.until(lambda s: s.state == "free flight")).counts
    await person.record()
    await fly_a_moment(person)
    await person.hands.tap("discard")
    await person.until(lambda s: s.counts[2] == before[2] + 1 and "undo" in s.message)
    await person.hands.tap("undo")
    await person.until(lambda s: s.counts == (before[0], before[1] + 1, before[2]))


async def recorded_again(person: PageReader) -> None:
    """Begin badly, throw it away, and record the same start once more."""
    before = (await person.until(lambda s: s.state == "free flight")).counts
    await person.record()
    await fly_a_moment(person)
    await person.hands.tap("discard")
    await person.until(lambda s: s.counts[2] == before[2] + 1)
    await kept(person)


async def rescued(person: PageReader) -> None:
    """Watch a policy that does not get there, take over, solve it, and keep it."""
    saved, *_ = (await person.until(lambda s: s.state == "free flight")).counts
    await person.record()
    await asyncio.sleep(WATCHING_S)
    sight = await person.until(lambda s: s.flier == "The policy flies")
    assert "at position" not in sight.ticks, f"a policy that needs no help: {sight}"
    await person.hands.hold("take_over", down=True)
    await person.until(lambda s: s.flier == "You fly")
    assert await person.fly(Reach(), SOLVING_S), f"not rescued: {person.sight}"
    await person.hands.hold("take_over", down=False)
    await person.keep()
    await person.until(lambda s: s.counts[0] == saved + 1)


async def fly_a_moment(person: PageReader) -> None:
    """Fly ahead for a second."""
    for _ in range(20):
        await person.hands.do(onwards(person.sight))
        await asyncio.sleep(0.05)
    await person.hands.rest()
