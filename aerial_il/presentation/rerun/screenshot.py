"""A picture of rerun's viewer without a screen: its page in a browser that has no window, drawn by the processor."""

import asyncio
import io
from pathlib import Path

import numpy as np
from PIL import Image

from aerial_il.core.places import MADE_BY
from aerial_il.presentation.films.video import signed_png
from aerial_il.presentation.rerun.chromium import BrowserError, Tab, browser
from aerial_il.presentation.rerun.program import ViewerError, page

WIDTH, HEIGHT = 1600, 1000
DRAWING = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")
TIME_BAR = 291, 208, 14  # pixels of the closed time panel: its left, and from its right and lower ends of the window
EVERY_S, STILL, PATIENCE_S = 2.0, 3, 180.0  # a picture is done once it has not changed so many times
LEAST_COLOURS = 200  # of a page that shows a flight; the page before has few


def take(file: Path, target: Path, *, at: float | None = None) -> Path:
    """Save what the viewer shows of a file.

    Args:
        file: an .rrd file. target: a .png or .webp file. at: share of the flight, 0 to 1; None for its end.

    Raises:
        BrowserError: there is no browser. ViewerError: the page never came to rest.
    """
    picture = asyncio.run(_seen(file, at))
    target.parent.mkdir(parents=True, exist_ok=True)
    Image.open(io.BytesIO(picture)).convert("RGB").save(target, pnginfo=signed_png(), xmp=MADE_BY.encode())
    return target


async def _seen(file: Path, at: float | None) -> bytes:
    with page(file) as (_, address):
        async with browser(*DRAWING, tab=Tab) as opened:
            tab = await opened("about:blank")
            await tab.look(width=WIDTH, height=HEIGHT, dark=False)
            await tab.call("Page.navigate", url=f"{address}&renderer=webgl&hide_welcome_screen")
            picture = await _at_rest(tab)
            if at is None:
                return picture
            left, right, low = TIME_BAR
            await tab.click(left + at * (WIDTH - right - left), HEIGHT - low, wait_s=EVERY_S)
            return await _at_rest(tab)


async def _at_rest(tab: Tab) -> bytes:
    """Return the picture once it shows something and does not change any more."""
    before, still = b"", 0
    for _ in range(int(PATIENCE_S / EVERY_S)):
        await asyncio.sleep(EVERY_S)
        try:
            now = await tab.snapshot()
        except BrowserError:  # nothing can be drawn while the page begins
            continue
        still = still + 1 if now == before and _shows_a_flight(now) else 0
        if still == STILL:
            return now
        before = now
    raise ViewerError(f"rerun's page had not come to rest after {PATIENCE_S:g} s; try again on a less busy machine.")


def _shows_a_flight(picture: bytes) -> bool:
    pixels = np.asarray(Image.open(io.BytesIO(picture)).convert("RGB"))[::4, ::4].reshape(-1, 3)
    return len(np.unique(pixels, axis=0)) >= LEAST_COLOURS
