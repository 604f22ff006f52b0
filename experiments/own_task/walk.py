"""A task of one's own, from nothing to a policy: written, flown once by keys, generated from, learned, evaluated.

    python -m experiments.own_task.walk --out runs/own_task

The commands are those of the README, run in a copy of this checkout, since ``aerial-il new`` writes into the package.
Who flies reads the page and presses its keys (``tests/teleop``); it is told nothing else. Each walk takes another
flight and another seed of training; ``results.json`` keeps successes and minutes.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from aerial_il.evaluation.result import FILE_NAME
from aerial_il.evaluation.statistics import wilson
from experiments.by_hand.fly import reader_at, served
from tests.teleop.chromium import browser
from tests.teleop.page_reader import Sight, Wish

HERE, ROOT = Path(__file__).resolve().parent, Path(__file__).resolve().parents[2]
TASK, ROBOT, LIMIT_S, GENERATED = "touch_ball", "fa_hexa_arm4", 60.0, 200


def towards(sight: Sight) -> Wish:
    """Wish to be at the point: by what the page says is left to go."""
    ahead, left, up = sight.numbers["tip to target, cm"]
    moves = {"forward": (ahead, 0.9), "lateral": (left, 0.9), "up": (up, 0.9)}
    return Wish(moves, precise=math.hypot(ahead, left, up) < 14.0)


async def fly(out: Path, seed: int, flights: int) -> int:
    """Record ``flights`` flights on the real page; return how many were solved."""
    solved = 0
    async with served(TASK, out, seed, realtime=os.geteuid() == 0, settings=[]) as url, browser() as opened:
        tab = await opened(url)
        await tab.look(width=1280, height=720)
        person = await reader_at(tab, "keys")
        for _ in range(flights):
            await person.record()
            solved += await person.fly(towards, LIMIT_S)
            await person.keep()
    return solved


def command(*words: str, cwd: Path) -> None:
    """Run a command of the README in the copy."""
    subprocess.run([sys.executable, "-m", "aerial_il", *words], check=True, cwd=cwd)


def walk(out: Path, number: int, flights: int, episodes: int) -> dict[str, Any]:
    """Walk the whole way once; return successes and minutes."""
    copy, seed = out.resolve() / "checkout", 930_000 + 100 * number
    shutil.rmtree(copy, ignore_errors=True)
    copy.mkdir(parents=True)
    archive = subprocess.run(["git", "archive", "HEAD"], cwd=ROOT, check=True, capture_output=True)
    subprocess.run(["tar", "-x", "-C", str(copy)], input=archive.stdout, check=True)
    os.environ["PYTHONPATH"] = str(copy)
    os.chdir(copy)  # what is run as a module is looked for here first
    started, minutes = time.monotonic(), dict[str, float]()

    def clock(what: str) -> None:
        minutes[what] = round((time.monotonic() - started) / 60 - sum(minutes.values()), 2)

    command("new", "task", TASK, cwd=copy)
    clock("new")
    solved = asyncio.run(fly(copy / "datasets" / "mine", seed, flights))
    clock("fly")
    command("generate", "dataset=datasets/mine", f"episodes={GENERATED}", "out=datasets/many", cwd=copy)
    clock("generate")
    command("train", "dataset=datasets/many", "run=runs/mine", f"seed={number}", cwd=copy)
    clock("train")
    command("evaluate", "policy=runs/mine", f"episodes={episodes}", f"seed={seed + 50}", "out=runs/mine/eval", cwd=copy)
    clock("evaluate")
    told = json.loads((copy / "runs" / "mine" / "eval" / FILE_NAME).read_text())["success"]
    return {"flown": flights, "solved": solved, "evaluated": episodes, "successes": told["count"], "minutes": minutes}


def main() -> None:
    """Read the command line, walk what is not walked yet, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("runs/own_task"))
    parser.add_argument("--walks", type=int, default=3)
    parser.add_argument("--flights", type=int, default=1)
    parser.add_argument("--episodes", type=int, default=200)
    args = parser.parse_args()
    args.out = args.out.resolve()
    record = HERE / "results.json"
    walks = json.loads(record.read_text())["walks"] if record.exists() else []
    for number in range(len(walks), args.walks):
        walks.append(walk(args.out, number, args.flights, args.episodes))
        about = {"robot": ROBOT, "task": "the template of `aerial-il new task`", "by": "a script that presses keys"}
        record.write_text(json.dumps({**about, "walks": walks}, indent=1) + "\n")
    for each in walks:
        low, high = (100 * bound for bound in wilson(each["successes"], each["evaluated"]))
        print(f"{each['successes']}/{each['evaluated']} ({low:.0f}-{high:.0f} %), minutes {each['minutes']}")


if __name__ == "__main__":
    main()
