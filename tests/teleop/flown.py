"""A whole flight by hand in this process, page and all, for tests that talk to it as a browser does."""

import asyncio
import ssl
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aerial_il.core import presets
from aerial_il.core.contracts import Policy
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.teleop.devices import drivers_of
from aerial_il.teleop.flight import Site, fly
from aerial_il.teleop.session.cockpit import Cockpit
from aerial_il.teleop.session.logbook import Logbook
from aerial_il.teleop.web.controls import Controls
from aerial_il.teleop.web.server import Server
from tests.teleop.chromium import Tab, browser
from tests.teleop.hands import shipped, world

READY = "window.teleop && teleop.shown && teleop.status?.role === 'controller'"


@dataclass
class Flown:
    """A flight under way."""

    env: BatchEnvironment
    cockpit: Cockpit
    server: Server


@asynccontextmanager
async def flown(
    out: Path,
    *,
    countdown: int = 10,
    port: int = 0,
    size: tuple[int, int] = (180, 240),
    devices: Sequence[str] = ("keyboard", "gamepad", "touch"),
    hardware: Mapping[str, Mapping[str, Any]] | None = None,
    tls: ssl.SSLContext | None = None,
    policy: Policy | None = None,
    controls: Controls | None = None,
    summary: Callable[[], str] | None = None,
    **settings: Any,
) -> AsyncIterator[Flown]:
    """Fly, on a page, into the folder ``out``, or watch ``policy`` fly."""
    env, bindings = world(**settings), shipped(*devices)
    drivers = drivers_of({name: presets.read("device", name) for name in devices}, hardware)
    logbook = Logbook(env, str(out), operator="ada", first_seed=5000, policy=policy and "policy")
    cockpit = Cockpit(env, bindings, logbook, policy=policy, countdown=countdown)
    there: asyncio.Future[Server] = asyncio.get_running_loop().create_future()
    site = Site(port=port, size=size, tls=tls, controls=controls, summary=summary)
    opened = there.set_result
    work = asyncio.create_task(fly(env, cockpit, bindings, site, operator="ada", drivers=drivers, opened=opened))
    try:
        await asyncio.wait({work, there}, return_when=asyncio.FIRST_COMPLETED)
        if work.done():
            await work
        yield Flown(env, cockpit, there.result())
    finally:
        work.cancel()
        with suppress(asyncio.CancelledError):
            await work
        env.close()


@asynccontextmanager
async def browsed(
    out: Path, window: tuple[int, int] = (1280, 720), *, phone: bool = False, **settings: Any
) -> AsyncIterator[tuple[Flown, Tab]]:
    """Fly as :func:`flown` does, with the page open in a browser, and require that no script of it failed."""
    async with flown(out, **settings) as flight, browser() as opened:
        tab = await opened("about:blank")  # the page asks for its window's size when it is read
        await tab.look(width=window[0], height=window[1], phone=phone)
        await tab.call("Page.navigate", url=flight.server.url)
        await tab.until(READY)
        yield flight, tab
        assert not tab.errors
