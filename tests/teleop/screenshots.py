"""Pictures of the page in every state, for the docs: ``python -m tests.teleop.screenshots docs/teleop``.

Each is taken in a real browser, of a real flight: wide and on a phone, light and dark.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Awaitable, Callable
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory

from PIL import Image

import aerial_il
from tests.teleop.chromium import Tab, browser
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
        await tab.look(width=size[0], height=size[1], dark=dark, phone=size != WIDE)
        await asyncio.sleep(0.7)
        with TemporaryDirectory() as place:
            shot = await tab.picture(Path(place) / "shot.png")
            image = Image.open(BytesIO(shot.read_bytes())).convert("RGB")
        if size != WIDE:
            image = image.resize((int(image.width * PHONE_SCALE), int(image.height * PHONE_SCALE)))
        image.save(self._folder / f"{name}.webp", quality=QUALITY)


async def by_hand(album: Album, flight: Flown, tab: Tab, open_page: Callable[[str], Awaitable[Tab]]) -> None:
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


async def lesson(album: Album, tab: Tab) -> None:
    """Begin the tutorial."""
    await ready(tab)
    await album.take(tab, "first_visit_light", dark=False)
    await tab.value("document.getElementById('tutorial-button').click(); 1")
    await tab.until("teleop.status.practice")
    await tab.hold("KeyW", 0.8)
    await tab.hold("KeyE", 0.8)
    await album.take(tab, "tutorial")
    await album.take(tab, "phone_tutorial", UPRIGHT)


async def shared(album: Album, tab: Tab) -> None:
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


async def ready(tab: Tab) -> None:
    await tab.until("window.teleop && teleop.shown && teleop.offset !== null && teleop.status?.role === 'controller'")


async def in_state(tab: Tab, state: str) -> None:
    await tab.until(f"document.body.dataset.state === '{state}'", timeout_s=60.0)


async def main(folder: Path) -> None:
    """Take all pictures into ``folder``."""
    album, size = Album(folder), (360, 480)
    with TemporaryDirectory() as place:
        async with flown(Path(place) / "a", task="pick_place", size=size, countdown=100) as flight, browser() as opened:
            tab = await opened(flight.server.url)
            await ready(tab)
            await by_hand(album, flight, tab, opened)
        async with flown(Path(place) / "b", task="pick_place", size=size) as flight, browser() as opened:
            await lesson(album, await opened(flight.server.url))
        expert = aerial_il.expert("fa_hexa_arm4", "reach")
        async with flown(Path(place) / "c", size=size, policy=expert) as flight, browser() as opened:
            await shared(album, await opened(flight.server.url))


if __name__ == "__main__":
    asyncio.run(main(Path(sys.argv[1])))
