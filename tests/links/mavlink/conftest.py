"""A robot behind the stand-in autopilot, in lockstep; skipped where pymavlink is missing."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack

import pytest

from aerial_il.links.mavlink.bench import Bench
from aerial_il.links.mavlink.client import OffboardClient

Fly = Callable[..., tuple[Bench, OffboardClient]]


@pytest.fixture
def fly() -> Iterator[Fly]:
    """Open benches with their clients, all closed at the end; what went wrong on their threads fails the test."""
    pytest.importorskip("pymavlink", reason="pymavlink is not installed: pip install 'aerial_il[mavlink]'")
    with ExitStack() as stack:

        def opened(robot: str = "ua_quad_arm4", **settings: object) -> tuple[Bench, OffboardClient]:
            bench = Bench(robot, **{"port": 0, "lockstep": True, **settings})  # type: ignore[arg-type]
            stack.callback(bench.close)
            client = OffboardClient(robot, port=bench.port, lockstep=True)
            stack.callback(client.close)
            client.connect()
            return bench, client

        yield opened
