"""Somebody before the page to fly on: real keys, real fingers, in a real browser without a window."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Any

from aerial_il.presentation.rerun import chromium
from aerial_il.presentation.rerun.chromium import BrowserError

KEYS = {  # code -> what else the browser wants to know
    "Tab": ("Tab", 9),
    "Enter": ("Enter", 13),
    "Backspace": ("Backspace", 8),
    "Space": (" ", 32),
    "ShiftLeft": ("Shift", 16),
    "ArrowLeft": ("ArrowLeft", 37),
    "ArrowRight": ("ArrowRight", 39),
}


class Tab(chromium.Tab):
    """An open page that is read, and touched as people do."""

    async def value(self, expression: str) -> Any:
        """Return what an expression of JavaScript is."""
        found = await self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        return found["result"].get("value")

    async def until(self, expression: str, timeout_s: float | None = None) -> None:
        """Wait for an expression to be true."""
        for _ in range(int((timeout_s or self.patience_s) / 0.05)):
            if await self.value(f"Boolean({expression})"):
                return
            await asyncio.sleep(0.05)
        raise BrowserError(f"never true: {expression}; the page says {await self.value('document.body.innerText')!r}")

    async def key(self, code: str, *, down: bool) -> None:
        """Press or release a key, as a keyboard does."""
        letter = code.removeprefix("Key").lower()
        key, number = KEYS.get(code, (letter, ord(letter[0].upper())))
        kind = "rawKeyDown" if down else "keyUp"
        await self.call("Input.dispatchKeyEvent", type=kind, code=code, key=key, windowsVirtualKeyCode=number)

    async def tap(self, code: str) -> None:
        """Press and release a key."""
        await self.key(code, down=True)
        await self.key(code, down=False)

    async def hold(self, code: str, seconds: float) -> None:
        """Hold a key for a while."""
        await self.key(code, down=True)
        await asyncio.sleep(seconds)
        await self.key(code, down=False)

    async def touch(self, kind: str, *place: float) -> None:
        """Put a finger down, move it, or lift it (no ``place``)."""
        points = [{"x": place[0], "y": place[1]}] if place else []
        await self.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)

    async def picture(self, target: Path) -> Path:
        """Save what is seen."""
        target.write_bytes(await self.snapshot())
        return target


Opener = Callable[[str], Awaitable[Tab]]
browser = partial(chromium.browser, tab=Tab)
