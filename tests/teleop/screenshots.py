"""Pictures of the page in every state, for the docs: ``python -m tests.teleop.screenshots docs/teleop [PART ...]``.

Each is taken in a real browser, of a real flight: wide and on a phone, light and dark.
"""

import asyncio
import sys
from collections.abc import Awaitable, Callable, Sequence
from contextlib import chdir
from functools import partial
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from PIL import Image

import aerial_il
from aerial_il.algorithms.interactive.costs import FlightCosts
from aerial_il.suite.physics.episode_state import FORCES
from aerial_il.teleop.page_operator import progress_of
from aerial_il.workflows.parts.sessions import summary
from tests.teleop.chromium import Opener, Tab, browser
from tests.teleop.flown import Flown, flown

WIDE, UPRIGHT, SIDEWAYS = (1280, 800), (390, 844), (844, 390)
QUALITY, PHONE_SCALE = 74, 0.75  # of the WebP files; phones are photographed at twice their size


class Album:
    """Takes pictures of a tab into a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    async def take(self, tab: Tab, name: str, size: tuple[int, int] = WIDE, *, dark: bool = True) -> None:
        """Save what the page looks like in a window of a size."""
        phone = min(size) < 500
        await tab.look(width=size[0], height=size[1], dark=dark, phone=phone)
        await asyncio.sleep(0.7)
        with TemporaryDirectory() as place:
            shot = await tab.picture(Path(place) / "shot.png")
            image = Image.open(BytesIO(shot.read_bytes())).convert("RGB")
        if phone:
            image = image.resize((int(image.width * PHONE_SCALE), int(image.height * PHONE_SCALE)))
        image.save(self._folder / f"{name}.webp", quality=QUALITY)


async def by_hand(album: Album, flight: Flown, tab: Tab, open_page: Opener) -> None:
    """Fly, and take a picture in each state."""
    await tab.value("localStorage.setItem('aerial_il.tutorial', 'done'); location.reload(); 1")
    await ready(tab)
    for dark in (True, False):
        await album.take(tab, f"free_flight_{'dark' if dark else 'light'}", dark=dark)
    await album.take(tab, "phone_upright", UPRIGHT)
    await album.take(tab, "phone_sideways_light", SIDEWAYS, dark=False)
    await tab.look(width=WIDE[0], height=WIDE[1])
    await tab.value("document.body.dataset.device = 'keyboard'; 1")
    await tab.tap("KeyH")
    await album.take(tab, "help")
    await tab.value("document.getElementById('help').close(); 1")
    await tab.value("document.getElementById('controls-button').click(); 1")
    await album.take(tab, "keys_light", dark=False)
    await tab.value("document.getElementById('controls').close(); 1")
    await tab.tap("KeyR")
    await album.take(tab, "countdown_light", dark=False)
    await in_state(tab, "recording")
    await tab.key("KeyW", down=True)
    await tab.key("KeyQ", down=True)
    await album.take(tab, "recording_dark")
    await album.take(tab, "recording_light", dark=False)
    await album.take(tab, "phone_recording_light", UPRIGHT, dark=False)
    await tab.key("KeyQ", down=False)
    await tab.key("KeyW", down=False)
    await tab.tap("KeyP")
    await in_state(tab, "paused")
    await album.take(tab, "paused")
    await tab.tap("KeyP")
    await in_state(tab, "recording")
    await tab.tap("KeyR")
    await in_state(tab, "review")
    await tab.value("const s = document.getElementById('scrub'); s.value = 420; s.dispatchEvent(new Event('input')); 1")
    await album.take(tab, "review_dark")
    await album.take(tab, "phone_review_light", UPRIGHT, dark=False)
    await album.take(tab, "phone_sideways_review", SIDEWAYS)
    await tab.look(width=WIDE[0], height=WIDE[1])
    await tab.tap("Enter")
    await in_state(tab, "idle")
    other = await open_page(flight.server.url)
    await other.until("teleop.shown && teleop.status?.role === 'spectator'")
    await album.take(other, "watching_light", dark=False)
    await tab.value("dispatchEvent(new Event('blur')); 1")
    await album.take(tab, "hands_off")


async def lesson(album: Album, _: Flown, tab: Tab, __: Opener) -> None:
    """Begin the tutorial."""
    await ready(tab)
    await album.take(tab, "first_visit_light", dark=False)
    await tab.value("document.getElementById('tutorial-button').click(); 1")
    await tab.until("teleop.status.practice")
    await tab.hold("KeyW", 0.8)
    await tab.hold("KeyE", 0.8)
    await album.take(tab, "tutorial")
    await album.take(tab, "phone_tutorial", UPRIGHT)


async def shared(album: Album, _: Flown, tab: Tab, __: Opener) -> None:
    """Watch a policy fly, take over, and let it end."""
    await tab.value("localStorage.setItem('aerial_il.tutorial', 'done'); location.reload(); 1")
    await ready(tab)
    await tab.tap("KeyR")
    await in_state(tab, "recording")
    await album.take(tab, "policy_dark")
    await tab.key("KeyT", down=True)
    await tab.until("teleop.status.flier === 'person'")
    await album.take(tab, "take_over_light", dark=False)
    await tab.key("KeyT", down=False)
    await in_state(tab, "review")
    await album.take(tab, "review_light", dark=False)


async def told(album: Album, flight: Flown, tab: Tab, _: Opener) -> None:
    """Show the numbers, another mode, and a blow that nothing makes good."""
    await tab.value("localStorage.setItem('aerial_il.tutorial', 'done'); location.reload(); 1")
    await ready(tab)
    await tab.value("document.getElementById('numbers').open = true; 1")
    await album.take(tab, "numbers_light", dark=False)
    await tab.value("document.getElementById('numbers').open = false; 1")
    await tab.tap("KeyR")
    await in_state(tab, "recording")
    await tab.tap("Tab")
    await tab.key("KeyW", down=True)
    await asyncio.sleep(0.5)
    await tab.key("KeyW", down=False)
    flight.env.simulation.view.userdata[0, FORCES] = 100.0  # N: a blow that takes long to deal by keys
    await tab.until("teleop.status.lost.length")
    await album.take(tab, "lost_gentle_dark")
    await album.take(tab, "phone_lost_gentle", UPRIGHT)


async def learner(album: Album, flight: Flown, tab: Tab, _: Opener) -> None:
    """Watch a learner of which two rounds are told, hold its success, and lose the line."""
    await tab.value("localStorage.setItem('aerial_il.tutorial', 'done'); location.reload(); 1")
    await ready(tab)
    rounds = [
        FlightCosts(flights=5, successes=5, steps=2600, expert_steps=810, solved_alone=2),
        FlightCosts(flights=5, successes=5, steps=2300, expert_steps=240, solved_alone=4),
    ]
    message = "Round 3 of 10: watch it fly."
    flight.server.lesson = {"message": message, "rounds": [progress_of(costs) for costs in rounds]}
    await tab.until("!document.getElementById('lesson').hidden")
    await album.take(tab, "learner_dark")
    await album.take(tab, "learner_light", dark=False)
    await album.take(tab, "phone_learner", UPRIGHT)
    await tab.look(width=WIDE[0], height=WIDE[1], dark=False)
    await tab.tap("KeyR")
    await in_state(tab, "recording")
    await tab.until("teleop.status.held > 0.02", timeout_s=60.0)
    await album.take(tab, "holding_light", dark=False)


async def ended(album: Album, flight: Flown, tab: Tab, open_page: Opener) -> None:
    """Keep two flights that were solved and one that was not, read the summary, and lose the line."""
    await tab.value("localStorage.setItem('aerial_il.tutorial', 'done'); location.reload(); 1")
    await ready(tab)
    for solved in (True, True, False):
        await tab.tap("KeyR")
        await in_state(tab, "recording")
        if not solved:
            await tab.tap("KeyR")
        await in_state(tab, "review")
        await tab.tap("Enter")
        await in_state(tab, "idle")
    await tab.until("teleop.status.counts.demos === 2 && teleop.status.counts.failures === 1")
    page = await open_page(flight.server.url.replace("/?", "/summary?"))
    await asyncio.sleep(1.0)
    await album.take(page, "summary_light", (1280, 1000), dark=False)
    await flight.server.close()
    await tab.until("!teleop.status")
    await album.take(tab, "lost_connection_dark")


async def ready(tab: Tab) -> None:
    await tab.until("window.teleop && teleop.shown && teleop.offset !== null && teleop.status?.role === 'controller'")


async def in_state(tab: Tab, state: str) -> None:
    await tab.until(f"document.body.dataset.state === '{state}'", timeout_s=60.0)


Work = Callable[[Album, Flown, Tab, Opener], Awaitable[None]]
PARTS: dict[str, tuple[Work, dict[str, Any]]] = {  # name -> what is photographed, in which flight
    "by_hand": (by_hand, {"task": "pick_place", "countdown": 100}),
    "lesson": (lesson, {"task": "pick_place"}),
    "shared": (shared, {"expert": True}),
    "told": (told, {"task": "press_button"}),
    "learner": (learner, {"expert": True}),
    "ended": (ended, {"expert": True}),
}


async def main(folder: Path, parts: Sequence[str] = ()) -> None:
    """Take the pictures of ``parts``, by default of all, into ``folder``."""
    album = Album(folder.resolve())
    for part in parts or PARTS:
        work, settings = PARTS[part]
        policy = aerial_il.expert("fa_hexa_arm4", "reach") if settings.get("expert") else None
        flight_of = {key: value for key, value in settings.items() if key != "expert"}
        with TemporaryDirectory() as place, chdir(place):  # so that the summary shows a path like anybody's
            out = Path("datasets/by_hand")
            told_by = partial(summary, str(out))
            async with (
                flown(out, size=(360, 480), policy=policy, summary=told_by, **flight_of) as flight,
                browser() as opened,
            ):
                tab = await opened(flight.server.url)
                await ready(tab)
                await work(album, flight, tab, opened)


if __name__ == "__main__":
    asyncio.run(main(Path(sys.argv[1]), sys.argv[2:]))
