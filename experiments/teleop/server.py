"""``aerial-il teleop`` in a process of its own, as a person starts it, and as a power cut ends it."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from aerial_il.core.errors import AerialError

GREETING = "Fly here: "
START_S = 180.0


class NoServerError(AerialError, RuntimeError):
    """A server that did not start."""


@dataclass(frozen=True)
class Served:
    """A server under way: its process and the address of its page."""

    process: asyncio.subprocess.Process
    url: str

    def kill(self) -> None:
        """End it at once, as ``kill -9`` does."""
        self.process.send_signal(signal.SIGKILL)


@asynccontextmanager
async def served(out: Path, *words: str) -> AsyncIterator[Served]:
    """Start ``aerial-il teleop out=OUT port=0 open=false WORDS`` and wait for its page; ends it afterwards."""
    command = (sys.executable, "-m", "aerial_il", "teleop", f"out={out}", "port=0", "open=false", *words)
    process = await asyncio.create_subprocess_exec(
        *command, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE, env={**os.environ, "DISPLAY": ""}
    )
    try:
        assert process.stdout is not None
        line = (await asyncio.wait_for(process.stdout.readline(), START_S)).decode()
        if not line.startswith(GREETING):
            assert process.stderr is not None
            raise NoServerError(f"{' '.join(command[1:])}: {(await process.stderr.read()).decode()[-500:]}")
        yield Served(process, line.removeprefix(GREETING).strip())
    finally:
        with suppress(ProcessLookupError):
            process.send_signal(signal.SIGINT)
        try:
            await asyncio.wait_for(process.communicate(), 20.0)
        except TimeoutError:
            process.kill()
            await process.communicate()
