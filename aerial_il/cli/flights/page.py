"""The page to fly on as the command line serves it: where it is, and whom an algorithm may learn from on it."""

from __future__ import annotations

import getpass
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from aerial_il.suite.batch import BatchEnvironment
    from aerial_il.teleop.web.server import Server

HUMAN, DRIVER = "human", "driver"
OPERATORS = (HUMAN, DRIVER)  # who sits at the controls: a person on the page, or a model of one
DEVICES = ("keyboard", "gamepad", "touch")


@contextmanager
def operator(name: str, env: BatchEnvironment) -> Iterator[Any]:
    """Yield who is asked for by ``expert=human`` or ``expert=driver``, at the controls of ``env``, of one world."""
    from aerial_il.cli.configuration import groups
    from aerial_il.core.rendering import require_rendering
    from aerial_il.teleop.devices import bindings_of
    from aerial_il.teleop.driver.operator import DriverOperator
    from aerial_il.teleop.flight import Site
    from aerial_il.teleop.page_operator import PageOperator

    if name == DRIVER:
        yield DriverOperator()
        return
    require_rendering("flying by hand")
    bindings = bindings_of({device: groups.read_option("device", device) for device in DEVICES})
    opened = partial(greet, open_page=True)
    with PageOperator(env, bindings, Site(port=8642), operator=getpass.getuser(), opened=opened) as person:
        yield person


def greet(server: Server, open_page: bool, program: str | None = None) -> None:
    """Say where the page is, and open it where there is a screen, in a window of ``program`` if there is one."""
    import socket
    import webbrowser

    from aerial_il.evaluation.films.window import has_screen
    from aerial_il.teleop.web.window import open_window

    print(f"Fly here: {server.url}", flush=True)
    if has_screen():
        if open_page:
            open_window(program, server.url) if program else webbrowser.open(server.url)
    else:
        tunnel = f"ssh -N -L {server.port}:127.0.0.1:{server.port} {getpass.getuser()}@{socket.gethostname()}"
        print(f"From another machine, first: {tunnel}", flush=True)
    print("Ctrl-C ends the session; everything that is saved stays.", flush=True)
