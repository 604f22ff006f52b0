"""All parts of a flight by hand put together: environment, cockpit, loop, film and page, until it is interrupted."""

import asyncio
import ssl
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass

from aerial_il.suite.batch import BatchEnvironment
from aerial_il.teleop.input.hardware import Attached, Driver
from aerial_il.teleop.input.inbox import Inbox
from aerial_il.teleop.input.mapping import Bindings
from aerial_il.teleop.session.cockpit import Cockpit
from aerial_il.teleop.session.loop import Loop
from aerial_il.teleop.session.perturb import possible
from aerial_il.teleop.session.readings import readings_of
from aerial_il.teleop.web.controls import Controls
from aerial_il.teleop.web.film import Film
from aerial_il.teleop.web.server import Server

CAMERAS = ("chase", "wrist")  # shown at first
VIEWS = (*CAMERAS, "scene")  # that may be shown
WATCH_S = 0.25


@dataclass(frozen=True)
class Site:
    """Where the page is served.

    Attributes:
        host: ``127.0.0.1`` for this machine alone. port: 0 for any that is free. size: (height, width) of pictures.
        tls: for a page over https. controls: mappings that may be changed. summary: writes a page about the folder.
    """

    host: str = "127.0.0.1"
    port: int = 0
    size: tuple[int, int] = (360, 480)
    tls: ssl.SSLContext | None = None
    controls: Controls | None = None
    summary: Callable[[], str] | None = None


async def fly(
    env: BatchEnvironment,
    cockpit: Cockpit,
    bindings: Bindings,
    site: Site,
    *,
    operator: str,
    drivers: Mapping[str, Driver] | None = None,
    opened: Callable[[Server], Awaitable[None] | None],
) -> None:
    """Serve the page and fly until cancelled or until a part fails.

    Args:
        env: what is flown. cockpit: its session. bindings: of the page's devices. site: where the page is served.
        operator: who flies. drivers: name -> how a device is opened that no browser reads.
        opened: called when the page is there.
    """
    inbox = Inbox(bindings)
    server = Server(
        inbox,
        about(env, bindings, operator, site),
        host=site.host,
        port=site.port,
        tls=site.tls,
        controls=site.controls,
        summary=site.summary,
    )
    await server.start()
    film = Film(env.model, CAMERAS, site.size, server.deliver)
    flight = Loop(cockpit, inbox, film.show, server.report)
    server.flight, server.film, film.watched = flight, film, False
    attached = [
        Attached(name, driver, inbox.note, lost=flight.leave, back=lambda name: flight.tell(f"{name} is back."))
        for name, driver in (drivers or {}).items()
    ]
    async with _running(server, film, flight, attached):
        if (greeting := opened(server)) is not None:
            await greeting
        while flight.error is None and film.error is None:
            await asyncio.sleep(WATCH_S)
    if (error := flight.error or film.error) is not None:
        raise error


@asynccontextmanager
async def _running(server: Server, film: Film, flight: Loop, attached: list[Attached]) -> AsyncIterator[None]:
    """Start what films, flies and reads devices, and end it, and the ``server`` that is up already."""
    try:
        for device in attached:
            device.start()
        film.start()
        flight.start()
        yield
    finally:
        for device in attached:
            device.close()
        flight.close()
        film.close()
        await server.close()


def about(env: BatchEnvironment, bindings: Bindings, operator: str, site: Site) -> dict[str, object]:
    """Return what the page says of the flight."""
    spec = env.spec
    return {
        "robot": spec.robot,
        "task": spec.task,
        "tier": spec.tier,
        "instruction": spec.instruction,
        "action": spec.action.level,
        "operator": operator,
        "bindings": bindings.to_dict(),
        "cameras": list(CAMERAS),
        "views": list(VIEWS),
        "summary": site.summary is not None,
        "grips": spec.action.labels[-1:] == ("gripper",),
        "perturbations": list(possible(env)),
        "size": list(site.size),
        "readings": [reading.to_dict() for reading in readings_of(spec.observation)],
        "rate": round(1.0 / spec.control_dt_s),
    }
