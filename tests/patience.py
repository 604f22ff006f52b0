"""Waiting for what is to happen: only a test that hangs is ended by the clock, after minutes."""

import asyncio
import time
from collections.abc import Callable

HANG_S, LOOK_S = 600.0, 0.01


async def until(seen: Callable[[], object]) -> None:
    """Wait for ``seen`` to be true; the limit of the test ends one that never is."""
    while not seen():
        await asyncio.sleep(LOOK_S)


def wait_until(seen: Callable[[], object]) -> None:
    """The same without a loop of events."""
    end = time.monotonic() + HANG_S
    while not seen():
        assert time.monotonic() < end, "never true"
        time.sleep(LOOK_S)
