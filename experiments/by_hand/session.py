"""A session as a person has it, end to end, through the real server and the real page.

    python -m experiments.by_hand.session --out runs/teleop/session
    python -m experiments.by_hand.session --out runs/teleop/session --hands pad

One flight is solved and kept, one discarded and brought back, one thrown away and recorded again. With ``--policy`` one
that is bad at ``reach`` is watched instead, taken over from, and its flight rescued. Then every file is
validated, replayed by its actions and flown again by its log. ``check`` alone does the latter for any folder:

    python -m experiments.by_hand.session check --out runs/teleop/reach_keys
"""

from __future__ import annotations

import argparse
import asyncio
import subprocess
import sys
from pathlib import Path

import aerial_il
from aerial_il.data.folder import DEMOS, FAILURES, DatasetFolder
from aerial_il.data.recording.reader import read_episode
from aerial_il.teleop.session.refly import refly
from experiments.by_hand.fly import reader_at, served
from tests.teleop.chromium import browser
from tests.teleop.sessions import discarded_and_brought_back, kept, recorded_again, rescued


async def fly(args: argparse.Namespace) -> None:
    """Have the session."""
    parts = (rescued,) if args.policy else (kept, discarded_and_brought_back, recorded_again)
    settings = [f"policy={args.policy}"] if args.policy else []
    async with (
        served("reach", args.out, 10000, realtime=args.realtime, settings=settings) as url,
        browser() as opened,
    ):
        tab = await opened(url)
        await tab.look(width=1280, height=720)
        person = await reader_at(tab, args.hands)
        for part in parts:
            await part(person)
            print(f"{part.__name__}: {person.sight.counts} saved, failures, in the trash", flush=True)


def check(out: Path) -> None:
    """Validate, replay and fly again by its log everything that lies in a folder."""
    for command in ("validate", "replay"):
        subprocess.run([sys.executable, "-m", "aerial_il", command, str(out)], check=True)
    folder, steps = DatasetFolder(out), 0
    files = [*folder.files(DEMOS), *folder.files(FAILURES)]
    spec = read_episode(files[0]).spec
    env = aerial_il.load_batch(
        spec.robot, spec.task, num_envs=1, num_threads=1, tier=spec.tier, action=spec.action.level
    )
    for file in files:
        steps += refly(env, read_episode(file), file)
    print(f"{len(files)} logs flown again, {steps} steps, every action and state the same to the bit")


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("command", nargs="?", choices=("fly", "check"), default="fly")
    parser.add_argument("--hands", choices=("keys", "pad"), default="keys")
    parser.add_argument("--out", type=Path, default=Path("runs/teleop/session"))
    parser.add_argument("--policy")
    parser.add_argument("--realtime", action="store_true")
    args = parser.parse_args()
    if args.command == "fly":
        asyncio.run(fly(args))
    check(args.out)


if __name__ == "__main__":
    main()
