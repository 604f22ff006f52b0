"""Two checkouts of the package beside each other: how fast each flies, and how far apart the same actions lead.

    python experiments/speed/checkouts.py OTHER [robot:task ...]

``OTHER`` is a checkout, or an unpacked archive of a commit. Each of the two flies in a process of its own; they take
turns, and ratios are formed within a turn, of the processor time of one thread. What they fly is what the expert of the
other commanded from the same starts.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

HERE = Path(__file__).parents[2]
CELLS = (
    "quad:hover", "ua_quad_arm4:reach", "fa_hexa_arm4:pick_place", "fa_hexa_arm4:open_door", "big_four_z1:pick_place",
)  # fmt: skip
WORLDS, STEPS, ROUNDS, SEED = 256, 50, 7, 900_000  # 50 control steps are 1 s


class Checkout:
    """A process that flies with the package of one checkout; a context."""

    def __init__(self, folder: Path) -> None:
        environment = {**os.environ, "PYTHONPATH": str(folder), "OMP_NUM_THREADS": "1"}
        command = [sys.executable, __file__, "--fly"]
        self._process = subprocess.Popen(command, env=environment, stdin=-1, stdout=-1, text=True, cwd=folder)

    def ask(self, **question: Any) -> Any:
        """Send a question and wait for its answer, see :func:`serve`."""
        assert self._process.stdin
        assert self._process.stdout
        self._process.stdin.write(json.dumps(question) + "\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())

    def __enter__(self) -> Checkout:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: TracebackType | None) -> None:
        self._process.communicate()


def serve() -> None:
    """Answer questions, a line each: load a cell, record its expert's actions, fly them and say the seconds."""
    import aerial_il

    env: Any = None
    actions = np.empty(0)
    for line in sys.stdin:
        asked = json.loads(line)
        answer: Any = None
        if asked["do"] == "load":
            robot, task = asked["cell"].split(":")
            env = aerial_il.load_batch(robot, task, num_envs=WORLDS, num_threads=1)
        elif asked["do"] == "record":
            expert = aerial_il.expert(*asked["cell"].split(":"))
            expert.attach(env)
            obs, flown = env.reset(SEED), []
            for _ in range(STEPS):
                flown.append(expert.act(obs))
                obs = env.step(flown[-1]).obs
            np.save(asked["file"], np.stack(flown))
        else:
            actions = np.load(asked["actions"])
            env.reset(SEED)
            began = time.process_time()
            for action in actions:
                env.step(action)
            answer = time.process_time() - began
            view = env.simulation.view
            np.savez(asked["file"], qpos=view.qpos, qvel=view.qvel, ctrl=env.ctrl)
        print(json.dumps(answer), flush=True)


def compare(cell: str, ours: Checkout, other: Checkout, folder: Path) -> None:
    """Print a row of the table."""
    actions, ends = str(folder / "actions.npy"), [str(folder / f"{name}.npz") for name in ("ours", "other")]
    for one in (ours, other):
        one.ask(do="load", cell=cell)
    other.ask(do="record", cell=cell, file=actions)
    rounds = [
        [one.ask(do="fly", actions=actions, file=end) for one, end in zip((ours, other), ends, strict=True)]
        for _ in range(ROUNDS + 1)
    ]
    ours_s, other_s = np.array(rounds[1:]).T
    ratio, each = other_s / ours_s, 1e6 / (WORLDS * STEPS)
    mine, theirs = map(np.load, ends)
    apart = ", ".join(f"{name} {np.abs(mine[name] - theirs[name]).max():.1e}" for name in ("qpos", "qvel", "ctrl"))
    print(
        f"| {cell} | {each * np.median(other_s):.2f} | {each * np.median(ours_s):.2f} | {np.median(ratio):.3f} | "
        f"{ratio.min():.2f}-{ratio.max():.2f} | {apart} |",
        flush=True,
    )


def main() -> None:
    """Compare the cells named on the command line, or :data:`CELLS`."""
    print("| cell | other, µs a world and step | ours | other / ours | range | largest difference after 1 s |")
    print("|---|--:|--:|--:|---|---|")
    with (
        tempfile.TemporaryDirectory(prefix="aerial_il-") as folder,
        Checkout(HERE) as ours,
        Checkout(Path(sys.argv[1]).resolve()) as other,
    ):
        for cell in sys.argv[2:] or CELLS:
            compare(cell, ours, other, Path(folder))


if __name__ == "__main__":
    serve() if sys.argv[1] == "--fly" else main()
