"""The page to fly on as the command line serves it: where it is, and whom an algorithm may learn from on it."""

from __future__ import annotations

import getpass
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from aerial_il.suite.batch import BatchEnvironment
    from aerial_il.teleop.web.server import Server

HUMAN, DRIVER = "human", "driver"
OPERATORS = (HUMAN, DRIVER)  # who sits at the controls: a person on the page, or a model of one
PORT = 8642
DEVICES = ("keyboard", "gamepad", "touch")


@contextmanager
def operator(name: str, env: BatchEnvironment, *, port: int = PORT) -> Iterator[Any]:
    """Yield who is asked for by ``expert=human`` or ``expert=driver``, at the controls of ``env``, of one world.

    A person's page is served on ``port``, or, said to them, on any that is free where that one is taken.
    """
    from aerial_il.core import presets
    from aerial_il.core.rendering import require_rendering
    from aerial_il.teleop.devices import bindings_of
    from aerial_il.teleop.driver.operator import DriverOperator
    from aerial_il.teleop.flight import Site
    from aerial_il.teleop.page_operator import PageOperator
    from aerial_il.teleop.web.server import PortTakenError

    if name == DRIVER:
        yield DriverOperator()
        return
    require_rendering("flying by hand")
    bindings = bindings_of({device: presets.read("device", device) for device in DEVICES})
    opened = partial(greet, open_page=True)

    def at(port: int) -> PageOperator:
        return PageOperator(env, bindings, Site(port=port), operator=getpass.getuser(), opened=opened)

    with ExitStack() as stack:
        try:
            person = stack.enter_context(at(port))
        except PortTakenError:
            print(f"port={port} is taken by another program: the page has one that is free.", flush=True)
            person = stack.enter_context(at(0))
        yield person


def greet(server: Server, open_page: bool, program: str | None = None) -> None:
    """Say where the page is, and open it where there is a screen, in a window of ``program`` if there is one."""
    import socket
    import webbrowser

    from aerial_il.presentation.films.window import has_screen
    from aerial_il.teleop.web.window import open_window

    print(f"Fly here: {server.url}", flush=True)
    if has_screen():
        if open_page:
            open_window(program, server.url) if program else webbrowser.open(server.url)
    else:
        tunnel = f"ssh -N -L {server.port}:127.0.0.1:{server.port} {getpass.getuser()}@{socket.gethostname()}"
        print(f"From another machine, first: {tunnel}", flush=True)
    print("Ctrl-C ends the session; everything that is saved stays.", flush=True)
