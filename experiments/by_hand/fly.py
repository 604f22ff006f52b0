"""Fly tasks by hand-like control of the real page: a real server, a real browser, in real time.

    python -m experiments.by_hand.fly fly --task reach --hands keys --episodes 10 --out runs/teleop
    python -m experiments.by_hand.fly table

Who flies reads the page's text and presses keys, or moves a mocked gamepad (``tests/teleop/page_reader.py``); it gets
nothing else. Each flight is one seed, counted from ``--seed``, and is kept whatever came of it; what is done is not
done again. On a machine that is busy with other work, ``--realtime`` gives the server a real-time priority, which takes
the rights of root; ``chrt -r 5`` before the command gives one to browser and driver. Results lie in
``experiments/by_hand/flights``, a file for each task and kind of hands.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import signal
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from statistics import median
from typing import Any

from aerial_il.evaluation.statistics import wilson
from tests.teleop.chromium import Tab, browser
from tests.teleop.page_reader import KeyHands, PadHands, PageReader
from tests.teleop.plans import PLANS

RESULTS = Path(__file__).parent / "flights"
LIMIT_S = {"reach": 60.0, "press_button": 60.0, "pick_place": 90.0}
REAL_TIME = ("chrt", "-r", "10")


@asynccontextmanager
async def served(task: str, out: Path, seed: int, *, realtime: bool, settings: list[str]) -> AsyncIterator[str]:
    """Start the real command and yield the page's address; interrupt it at the end, as a person does."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # what a shell starts in the background is deaf to it
    command = [sys.executable, "-m", "aerial_il", "teleop", "robot=fa_hexa_arm4", f"task={task}", f"out={out}"]
    command += [f"seed={seed}", "port=0", "open=false", "operator=script", *settings]
    process = await asyncio.create_subprocess_exec(
        *(REAL_TIME if realtime else ()), *command, stdout=asyncio.subprocess.PIPE
    )
    assert process.stdout is not None
    try:
        lines = [line async for line in _until(process.stdout, b"Fly here: ")]
        yield lines[-1].decode().split()[-1]
    finally:
        process.send_signal(signal.SIGINT)
        await process.communicate()


async def _until(stream: asyncio.StreamReader, start: bytes) -> AsyncIterator[bytes]:
    """Read lines up to the first one that begins so."""
    async for line in stream:
        yield line
        if line.startswith(start):
            return
    raise EOFError(f"the server ended before it had said {start.decode()!r}")


async def reader_at(tab: Tab, hands: str) -> PageReader:
    """Sit somebody down at the page."""
    if hands == "keys":
        return PageReader(tab, KeyHands(tab))
    pad = PadHands(tab)
    await pad.plug_in()
    return PageReader(tab, pad)


async def fly(args: argparse.Namespace) -> None:
    """Fly what is left of the flights that were asked for."""
    out = Path(args.out) / f"{args.task}_{args.hands}"
    record = RESULTS / f"{args.task}_{args.hands}_{args.seed}.json"
    done: list[dict[str, Any]] = json.loads(record.read_text())["flights"] if record.exists() else []
    settings = [f"time_scale={args.time_scale}", f"tier={args.tier}"]
    async with (
        served(args.task, out, args.seed, realtime=args.realtime, settings=settings) as url,
        browser() as opened,
    ):
        tab = await opened(url)
        await tab.look(width=1280, height=720)
        person = await reader_at(tab, args.hands)
        while len(done) < args.episodes:
            begun, plan = time.monotonic(), PLANS[args.task]()
            await person.record()
            before = await tab.value("teleop.status.pace")
            solved = await person.fly(plan, LIMIT_S[args.task] / float(args.time_scale))
            shown = await tab.value("teleop.status")  # for the record; nobody flies by it
            await person.keep()
            done.append(
                {
                    "seed": shown["seed"],
                    "solved": solved,
                    "flown_s": round(shown["steps"] * 0.02, 2),
                    **{key: shown["pace"][key] - before[key] for key in ("ticks", "late")},
                    "all_s": round(time.monotonic() - begun, 1),
                }
            )
            _write(record, args, done)
            print(done[-1], getattr(plan, "doing", ""), flush=True)
        if tab.errors:
            raise SystemExit(f"the page met errors: {tab.errors}")


def _write(record: Path, args: argparse.Namespace, flights: list[dict[str, Any]]) -> None:
    settings = {"task": args.task, "hands": args.hands, "tier": args.tier, "time_scale": args.time_scale}
    record.parent.mkdir(parents=True, exist_ok=True)
    record.write_text(json.dumps({**settings, "realtime": args.realtime, "flights": flights}, indent=1) + "\n")


def table() -> None:
    """Print what was flown, with Wilson intervals of 95 %."""
    print("| task | hands | seeds | solved | 95 % | flown, s (median) | ticks on time |")
    print("|---|---|---|--:|---|--:|--:|")
    for file in sorted(RESULTS.glob("*.json")):
        told = json.loads(file.read_text())
        flights = told["flights"]
        count, total = sum(flight["solved"] for flight in flights), len(flights)
        low, high = wilson(count, total)
        seeds = f"{min(f['seed'] for f in flights)}–{max(f['seed'] for f in flights)}"
        flown = median(f["flown_s"] for f in flights)
        print(
            f"| {told['task']} | {told['hands']} | {seeds} | {count}/{total} | {100 * low:.0f}–{100 * high:.0f} % "
            f"| {flown:.1f} | {on_time(flights)} |"
        )


def on_time(flights: list[dict[str, Any]]) -> str:
    """Return the share of ticks that began in time, of flights that counted them."""
    ticks, late = (sum(flight.get(key, 0) for flight in flights) for key in ("ticks", "late"))
    return f"{100 * (1 - late / ticks):.1f} %" if ticks else "–"


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", choices=("fly", "table"))
    parser.add_argument("--task", choices=tuple(PLANS), default="reach")
    parser.add_argument("--hands", choices=("keys", "pad"), default="keys")
    parser.add_argument("--tier", default="calm")
    parser.add_argument("--episodes", type=int, default=10)
    parser.add_argument("--seed", type=int, default=10000)
    parser.add_argument("--time-scale", default="1")
    parser.add_argument("--out", default="runs/teleop")
    parser.add_argument("--realtime", action="store_true")
    args = parser.parse_args()
    if args.command == "table":
        table()
    else:
        asyncio.run(fly(args))


if __name__ == "__main__":
    main()
