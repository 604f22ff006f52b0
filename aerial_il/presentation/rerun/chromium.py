"""A real browser without a window, driven over its DevTools protocol."""

import asyncio
import base64
import json
import shutil
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import aiohttp

from aerial_il.core.errors import AerialError

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
OPTIONS = ("--headless=new", "--no-sandbox", "--hide-scrollbars", "--remote-debugging-port=0")
PLAIN = ("--disable-gpu",)


class BrowserError(AerialError, RuntimeError):
    """A browser that is not there, or a page that does not show what it should."""


class Tab:
    """One open page.

    Attributes:
        patience_s: how long it is waited for the browser, and for what is to be true.
    """

    patience_s = 20.0

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self._socket, self._numbers = socket, count(1)
        self._answers: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self.errors: list[str] = []
        self._reader = asyncio.create_task(self._read())

    async def call(self, method: str, **params: Any) -> dict[str, Any]:
        """Ask the browser for something and return its answer."""
        number = next(self._numbers)
        self._answers[number] = asyncio.get_running_loop().create_future()
        await self._socket.send_str(json.dumps({"id": number, "method": method, "params": params}))
        return await self._answers[number]

    async def look(self, *, width: int, height: int, dark: bool = True, phone: bool = False) -> None:
        """Give the window a size and a scheme of colours."""
        size = {"width": width, "height": height, "deviceScaleFactor": 2 if phone else 1, "mobile": phone}
        await self.call("Emulation.setDeviceMetricsOverride", **size)
        await self.call("Emulation.setTouchEmulationEnabled", enabled=phone)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        await self.call("Emulation.setEmulatedMedia", features=[scheme])

    async def click(self, x: float, y: float, wait_s: float = 0.05) -> None:
        """Press and release the left button of the mouse, each after a wait, for pages that look once in a frame."""
        for kind, buttons in (("mouseMoved", 0), ("mousePressed", 1), ("mouseMoved", 1), ("mouseReleased", 0)):
            how = {"button": "left", "buttons": buttons, "clickCount": 1}
            await self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **how)
            await asyncio.sleep(wait_s)

    async def snapshot(self) -> bytes:
        """Return what is seen as PNG.

        Raises:
            BrowserError: the page cannot be drawn just now, as may happen while it begins.
        """
        shot = await self.call("Page.captureScreenshot", format="png")
        if "data" not in shot:
            raise BrowserError(f"The browser took no picture: {shot}.")
        return base64.b64decode(shot["data"])

    async def _read(self) -> None:
        async for message in self._socket:
            answer = json.loads(message.data)
            if "id" in answer:
                self._answers.pop(answer["id"]).set_result(answer.get("result") or {"result": answer.get("error", {})})
            elif answer["method"] == "Runtime.exceptionThrown":
                details = answer["params"]["exceptionDetails"]
                self.errors.append(details.get("exception", {}).get("description", details["text"]))


@asynccontextmanager
async def browser[T: Tab](*drawing: str, tab: type[T]) -> AsyncIterator[Callable[[str], Awaitable[T]]]:
    """Start a browser; what it yields opens pages.

    Args:
        drawing: options about how it draws; none of them for a page without 3-D. tab: class of its pages.

    Raises:
        BrowserError: there is none on this machine.
    """
    if BROWSER is None:
        raise BrowserError("No Chromium or Chrome on this machine.")
    with TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        process = await asyncio.create_subprocess_exec(
            BROWSER, *OPTIONS, *(drawing or PLAIN), f"--user-data-dir={profile}", "about:blank",
            stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.DEVNULL,
        )  # fmt: skip
        try:
            port = await _port(Path(profile) / "DevToolsActivePort", tab.patience_s)
            async with aiohttp.ClientSession() as session:
                yield lambda url: _open(tab, session, port, url)
        finally:
            process.terminate()
            await process.wait()


async def _port(file: Path, patience_s: float) -> int:
    for _ in range(int(patience_s / 0.05)):
        if file.exists() and (lines := file.read_text().splitlines()):
            return int(lines[0])
        await asyncio.sleep(0.05)
    raise BrowserError("The browser did not start.")


async def _open[T: Tab](kind: type[T], session: aiohttp.ClientSession, port: int, url: str) -> T:
    async with session.put(f"http://127.0.0.1:{port}/json/new?about:blank") as answer:
        address = (await answer.json())["webSocketDebuggerUrl"]
    tab = kind(await session.ws_connect(address, max_msg_size=0))
    for domain in ("Page", "Runtime"):
        await tab.call(f"{domain}.enable")
    await tab.call("Emulation.setFocusEmulationEnabled", enabled=True)
    await tab.call("Page.navigate", url=url)
    return tab
