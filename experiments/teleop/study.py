"""Flying by hand, measured where a person notices: the loop, the delay of a key, a narrow link, silence, power cuts.

The server is the command as it is typed, in a process of its own; the page is shown by a real browser without a window.
"""

from __future__ import annotations

import asyncio
import os
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import ClassVar

import numpy as np

import aerial_il
from aerial_il.core.errors import AerialError, InvalidValueError
from aerial_il.data.folder import DatasetFolder
from aerial_il.data.recording.reader import read_episode
from aerial_il.data.recovery import recover_episode
from aerial_il.data.replay import replay
from aerial_il.presentation.rerun.chromium import BROWSER, BrowserError
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.teleop.flight import Site, fly
from aerial_il.teleop.input.mapping import Bindings
from aerial_il.teleop.session.cockpit import Cockpit
from aerial_il.teleop.session.logbook import Logbook
from aerial_il.teleop.session.refly import refly
from aerial_il.teleop.web.server import Server
from experiments.common.report import Report, Row, Target, bar
from experiments.teleop.hands import Tab, browser
from experiments.teleop.narrow import narrowed
from experiments.teleop.page_client import PageClient, sitting
from experiments.teleop.server import served

ON_TIME_PERCENT, KEY_MS, AGE_MS, STALE_MS = 95.0, 100.0, 500.0, 300.0
NARROW_BYTES_PER_S, NARROW_DELAY_S = 60e3, 0.04
BUFFERED_STEPS = 64  # of an open episode, may be lost with the power
KEYS = ("KeyW", "KeyS", "KeyA", "KeyD", "KeyE", "KeyQ", "ArrowLeft", "ArrowRight")
READY = "window.teleop && teleop.shown && teleop.offset !== null && teleop.status?.role === 'controller'"
NOTES = (
    "Server: aerial-il teleop with its defaults, in a process of its own, images of two cameras rendered in software. "
    "Page: headless Chromium on the same machine.",
    "On time: ticks begun within 5 ms of their deadline, once the page shows images. Key: from a key event in the "
    "browser to the first image of a state that it had acted on. Age: of the image that is shown, by the server's "
    "clock.",
    f"Narrow: a proxy that lets {NARROW_BYTES_PER_S / 1e3:g} kB/s through with a delay of {1e3 * NARROW_DELAY_S:g} ms.",
    "Silence: from the last message of a page with a key held to a command of zero; by the server in this process.",
    "Killed: kill -9 at a random moment while a second episode is recorded. Whole: every episode reported to the page "
    "is read with its checksums and flown again from its log. Recovered: the unfinished one, without "
    f"more than the last {BUFFERED_STEPS} of the steps that the page had been sent.",
)


@dataclass(frozen=True, kw_only=True)
class Teleop:
    """Settings.

    Attributes:
        robot, task: what is flown. size: height and width of the pictures. duration_s: of the measured flight, and half
            of it over the narrow link. keys: taps that are timed. silences: how often the page falls silent.
        kills: how often the power is cut. seed: of the moments of the cuts.
    """

    name: ClassVar[str] = "teleop"
    question: ClassVar[str] = "Does flying by hand run in real time, show every input promptly, and lose nothing?"

    robot: str = "fa_hexa_arm4"
    task: str = "pick_place"
    size: tuple[int, int] = (360, 480)
    duration_s: float = 30.0
    keys: int = 40
    silences: int = 10
    kills: int = 50
    seed: int = 0

    def __post_init__(self) -> None:
        if min(self.duration_s, self.keys, self.silences) <= 0 or self.kills < 0:
            raise InvalidValueError("teleop needs duration_s, keys and silences above 0, and kills of at least 0.")

    def run(self, folder: Path, *, progress: bool = True) -> Report:
        """Fly, and cut the power; see :class:`Study`."""
        if BROWSER is None:
            raise BrowserError("bench teleop shows the page in Chromium or Chrome, and there is none on this machine.")
        started = time.perf_counter()
        with TemporaryDirectory(prefix="aerial_il-") as scratch:
            wide, latencies = asyncio.run(self._page(Path(scratch) / "wide"))
            narrow = asyncio.run(self._narrow(Path(scratch) / "narrow"))
            env = aerial_il.load_batch(self.robot, self.task, num_envs=1, num_threads=1)
            silences = asyncio.run(self._silences(env, Path(scratch) / "silences"))
            cuts = [self._cut(env, Path(scratch) / f"cut{i}", i) for i in bar(range(self.kills), self.name, progress)]
            replayed = _replayed(env, Path(scratch) / "wide")
            env.close()
        page = {**wide, **replayed}
        return Report(
            study=self,
            targets=targets_of(page, narrow, silences, cuts),
            tables={"Page": [page], "Narrow link": [narrow], **({"Power cuts": _summary(cuts)} if cuts else {})},
            notes=(*NOTES, _priority()),
            details={"keys_ms": latencies, "silences_ms": silences, "cuts": cuts},
            wall_time_s=time.perf_counter() - started,
        )

    def _words(self) -> tuple[str, ...]:
        height, width = self.size
        return f"robot={self.robot}", f"task={self.task}", f"size=[{height},{width}]", "operator=bench"

    async def _page(self, out: Path) -> tuple[Row, list[float]]:
        """Fly with keys before a browser, and record it; return what was found, and the delay of each key in ms."""
        async with served(out, *self._words()) as server, browser() as opened:
            tab = await opened(server.url)
            await tab.until(READY, timeout_s=60.0)
            await _ages(tab)
            before = await tab.value("teleop.status.pace")
            await tab.tap("KeyR")
            await tab.until("document.body.dataset.state === 'recording'")
            until = time.monotonic() + self.duration_s
            for i in range(self.keys):
                await tab.hold(KEYS[i % len(KEYS)], 0.06)
                await asyncio.sleep(0.1 + 0.013 * (i % 7))
            while time.monotonic() < until:
                await asyncio.sleep(0.1)
            after, latencies = await tab.value("teleop.status.pace"), await tab.value("teleop.latencies")
            ages = await tab.value("ages")
            await tab.tap("KeyR")
            await tab.until("document.body.dataset.state === 'review'")
            await tab.tap("Enter")
            await tab.until("teleop.status.counts.failures + teleop.status.counts.demos === 1")
        ticks, late = after["ticks"] - before["ticks"], after["late"] - before["late"]
        row = {
            "ticks": ticks,
            "on_time_percent": round(100 * (1 - late / ticks), 2),
            "keys": len(latencies),
            "key_ms": round(float(np.median(latencies)), 1),
            "key_ms_95": round(float(np.percentile(latencies, 95)), 1),
            "age_ms": round(float(np.median(ages)), 1),
            "age_ms_95": round(float(np.percentile(ages, 95)), 1),
        }
        return row, [round(latency, 1) for latency in latencies]

    async def _narrow(self, out: Path) -> Row:
        """Look at the flight over a narrow link."""
        async with served(out, *self._words()) as server, browser() as opened:
            port = int(server.url.split(":")[2].split("/")[0])
            link = {"bytes_per_s": NARROW_BYTES_PER_S, "delay_s": NARROW_DELAY_S}
            async with narrowed(port, **link) as far:
                tab = await opened(server.url.replace(f":{port}/", f":{far}/"))
                await tab.until(READY, timeout_s=60.0)
                await asyncio.sleep(4.0)
                await _ages(tab)
                await asyncio.sleep(self.duration_s / 2)
                ages = await tab.value("ages")
        return {
            "age_ms": round(float(np.median(ages)), 1),
            "age_ms_95": round(float(np.percentile(ages, 95)), 1),
        }

    async def _silences(self, env: BatchEnvironment, out: Path) -> list[float]:
        """Return ms from the last word of a page that holds a key to a command of zero, seen every 2 ms."""
        bindings, found = Bindings({"KeyW": "forward+"}), list[float]()
        cockpit = Cockpit(env, bindings, Logbook(env, str(out), operator="bench"))
        there: asyncio.Future[Server] = asyncio.get_running_loop().create_future()
        site = Site(size=self.size)
        flight = asyncio.create_task(fly(env, cockpit, bindings, site, operator="bench", opened=there.set_result))
        url = (await there).url
        for _ in range(self.silences):
            async with sitting(url) as (page, speaking):
                page.held = ["KeyW"]
                await page.until(lambda status: status["role"] == "controller" and status["speed"] > 0.2)
                speaking.cancel()
                while cockpit.status().speed > 0.0:
                    await asyncio.sleep(0.002)
                found.append(round(1e3 * (time.perf_counter() - page.spoke), 1))
            await asyncio.sleep(0.1)
        flight.cancel()
        with suppress(asyncio.CancelledError):
            await flight
        return found

    def _cut(self, env: BatchEnvironment, out: Path, number: int) -> Row:
        rng = np.random.default_rng((self.seed, number))
        status = asyncio.run(self._killed(out, rng.uniform(0.1, 3.0), KEYS[int(rng.integers(len(KEYS)))]))
        return {**status, **found_rows(env, out, status)}

    async def _killed(self, out: Path, after_s: float, key: str) -> Row:
        """Record one episode, begin another one, and kill the server; return what the page had been told."""
        async with served(out, *self._words()) as server, sitting(server.url) as (page, _):
            await _record(page, key)
            await asyncio.sleep(0.5)
            for control, state in (("KeyR", "review"), ("Enter", "idle")):
                page.press(control)
                await page.until(lambda status, state=state: status["state"] == state)
            await page.until(lambda status: status["waiting"] == 0 and status["counts"]["failures"] == 1)
            await _record(page, key)
            await asyncio.sleep(after_s)
            status = page.status
            server.kill()
            await server.process.wait()
        return {"after_s": round(after_s, 2), "finished": status["counts"]["failures"], "steps": status["steps"]}


async def _record(page: PageClient, key: str) -> None:
    await page.until(lambda status: status["role"] == "controller" and status["state"] == "idle")
    page.press("KeyR")
    await page.until(lambda status: status["state"] == "recording")
    page.held = [key]


async def _ages(tab: Tab) -> None:
    """Have the page note how old what it shows is, twenty times a second."""
    age = "performance.now() + teleop.offset - 1000 * teleop.shown.taken"
    await tab.value(f"window.ages = []; setInterval(() => ages.push({age}), 50); 1")


def found_rows(env: BatchEnvironment, out: Path, status: Row) -> Row:
    """Return what is there after the power cut: finished episodes that are whole, steps of the open one."""
    whole = sum(_is_whole(env, file) for kind in ("demos", "failures") for file in DatasetFolder(out).files(kind))
    recovered, problem = 0, ""
    for part in sorted(out.glob("*/*.part")):
        try:
            recovered = len(read_episode(recover_episode(part, out / "recovered.mcap").path))
        except AerialError as error:
            problem = str(error).replace(f"{out}/", "")
    enough = recovered >= status["steps"] - BUFFERED_STEPS and (recovered > 0 or status["steps"] <= BUFFERED_STEPS)
    intact = whole == status["finished"] and enough
    return {"whole": whole, "recovered": recovered, "intact": intact, "problem": problem}


def _is_whole(env: BatchEnvironment, file: Path) -> bool:
    try:
        episode = read_episode(file)
        return refly(env, episode, file) == len(episode)
    except AerialError:
        return False


def _replayed(env: BatchEnvironment, out: Path) -> Row:
    files = [file for kind in ("demos", "failures") for file in DatasetFolder(out).files(kind)]
    episodes = [read_episode(file) for file in files]
    steps = sum(len(episode) for episode in episodes)
    again = sum(refly(env, episode) for episode in episodes if replay(env, episode) == len(episode))
    return {"steps": steps, "replayed_percent": round(100 * again / steps, 2) if steps else 0.0}


def _summary(cuts: Sequence[Row]) -> list[Row]:
    lost = [cut["steps"] - cut["recovered"] for cut in cuts]
    return [
        {
            "cuts": len(cuts),
            "finished": sum(cut["finished"] for cut in cuts),
            "whole": sum(cut["whole"] for cut in cuts),
            "open_recovered": sum(cut["recovered"] > 0 for cut in cuts),
            "most_steps_lost": max(lost),
            "intact": sum(cut["intact"] for cut in cuts),
        }
    ]


def targets_of(page: Row, narrow: Row, silences: Sequence[float], cuts: Sequence[Row]) -> tuple[Target, ...]:
    spread = f"95 % of {page['keys']} within {page['key_ms_95']:g} ms"
    found = [
        Target("ticks on time", "at least", ON_TIME_PERCENT, page["on_time_percent"], "%", f"{page['ticks']} ticks"),
        Target("key to visible change, median", "at most", KEY_MS, page["key_ms"], "ms", spread),
        Target("age of the picture over a narrow link, median", "at most", AGE_MS, narrow["age_ms"], "ms",
               f"95 % within {narrow['age_ms_95']:g} ms"),
        Target("input log flown again, bit for bit", "at least", 100.0, page["replayed_percent"], "% of steps",
               f"{page['steps']} steps"),
        Target("silence to a command of zero, median", "at most", STALE_MS, float(np.median(silences)), "ms",
               f"{len(silences)} times, at most {max(silences):g} ms"),
    ]  # fmt: skip
    if cuts:
        intact = sum(cut["intact"] for cut in cuts)
        found.append(Target("power cuts that lost nothing", "at least", len(cuts), intact, "", f"of {len(cuts)}"))
    return tuple(found)


def _priority() -> str:
    """Say at what priority it ran, which on a busy machine decides."""
    policy = {os.SCHED_OTHER: "as any other program", os.SCHED_RR: "round-robin", os.SCHED_FIFO: "first-in first-out"}
    name = policy.get(os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK, "another policy")
    real_time = "" if name == policy[os.SCHED_OTHER] else "real-time priority, "
    return f"Priority: {real_time}{name}, nice {os.getpriority(os.PRIO_PROCESS, 0)}; load {os.getloadavg()[0]:.1f}."
