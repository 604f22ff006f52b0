"""Ctrl-C in every command that takes long: an answer within two seconds, what was finished kept, no traceback."""

import os
import resource
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from aerial_il.cli import commands
from aerial_il.cli.main import main
from tests.patience import HANG_S

ANSWER_S = 2.0  # of the processor, from Ctrl-C on
AT_ONCE = {
    "compare",
    "delete",
    "doctor",
    "export",
    "filter",
    "info",
    "leaderboard",
    "list",
    "merge",
    "new",
    "recover",
    "relabel",
    "reward",
    "runs",
    "simulate",  # of the links that serve, in their own tests
    "split",
    "undo",
    "validate",
}  # done before one presses
LONG = {  # command -> what is typed, and the sign on stderr or stdout that it is at work
    "bench": (["experts", "bench.episodes=2000"], "bench"),
    "browse": (["demos", "port=0", "open=false"], "http"),
    "card": (["demos", "out=OUT/card.html"], "card:"),
    "collect": (["task=pick_place", "episodes=5000", "num_envs=8", "out=OUT/d"], "collect:"),
    "convert": (["demos", "out=OUT/l"], "convert:"),
    "demo": (["task=pick_place", "episodes=5000", "out=OUT/demo"], "collect:"),
    "docs": (["out=null", "site=OUT/site"], "reading sources"),
    "evaluate": (["policy=run", "episodes=5000", "num_envs=8", "out=OUT/e"], "evaluate"),
    "film": (["out=OUT/f.webp"], "%"),
    "fly": (["policy=hover", "robot=quad", "task=hover", "link.clock=wall", "episodes=500", "out=OUT/f"], "fly:"),
    "generate": (["dataset=demos", "episodes=5000", "num_envs=8", "out=OUT/made"], "generate:"),
    "inspect": (["demos", "save=OUT/a.rrd"], ""),
    "prefer": (["demos", "by=hand", "length=20", "out=OUT/p.jsonl", "port=0", "open=false"], "http"),
    "publish": (["demos", "out=OUT/hub", "license=mit"], "convert:"),
    "replay": (["demos"], "replay:"),
    "judge": (["demos"], "judge:"),
    "report": (["demos", "out=OUT/page.html"], ""),
    "segment": (["demos", "port=0", "open=false"], "http"),
    "teleop": (["task=reach", "out=OUT/hand", "port=0", "open=false"], "http"),
    "train": (["dataset=demos", "run=OUT/r"], "train bc"),
    "view": (["policy=run", "viewer=page", "out=OUT/seen.html"], ""),
}
MORE = {
    "train sac": (
        ["train", "algorithm=sac", "policy=squashed_gaussian", "env=gymnasium:Pendulum-v1", "run=OUT/s"], "train sac",
    ),
    "teleop rerun": (["teleop", "task=reach", "out=OUT/seen", "port=0", "open=false", "rerun=true"], "http"),
    "train dagger": (
        ["train", "algorithm=dagger", "algorithm.training.steps=50", "dataset=demos", "run=OUT/g"],
        "collect:",
    ),
    "collect processes": (
        ["collect", "env=gymnasium:Pendulum-v1", "policy=random", "success=survived", "episodes=5000", "threads=2",
         "num_envs=4", "out=OUT/p"],
        "collect:",
    ),
}  # fmt: skip
CASES = {**{name: ([name, *words], sign) for name, (words, sign) in LONG.items()}, **MORE}


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("interrupted")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        quiet = "progress=false"
        assert main(["collect", "task=reach", "episodes=40", "out=demos", quiet]) == 0
        small = ["policy.hidden=[8]", "algorithm.steps=4", "experiment=quick"]
        assert main(["train", "dataset=demos", "run=run", *small, quiet]) == 0
    return folder


def used_s(pid: int) -> float:
    """Return the processor time (s) of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def ended_s() -> float:
    """Return that of all processes that were started here and have ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def test_every_command_is_known_to_be_short_or_is_interrupted() -> None:
    assert AT_ONCE | LONG.keys() == set(commands.names())


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_ctrl_c_is_answered(case: str, home: Path, tmp_path: Path) -> None:
    typed, sign = CASES[case]
    words = [word.replace("OUT", str(tmp_path)) for word in typed]
    said: list[str] = []
    started = threading.Event()
    process = subprocess.Popen(
        [sys.executable, "-u", "-m", "aerial_il", *words], cwd=home, text=True, stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env={**os.environ, "OMP_NUM_THREADS": "1"},
    )  # fmt: skip

    def listen() -> None:
        assert process.stdout is not None
        while text := os.read(process.stdout.fileno(), 4096).decode(errors="replace"):
            said.append(text)
            if sign in "".join(said):
                started.set()

    listener = threading.Thread(target=listen, daemon=True)
    listener.start()
    if sign:
        assert started.wait(HANG_S) or process.poll() is not None, "".join(said)
        time.sleep(1.0)
    else:
        time.sleep(6.0)
    if process.poll() is not None:
        assert process.returncode == 0, "".join(said)
        pytest.skip("it was done before")
    before = ended_s() + used_s(process.pid)
    process.send_signal(signal.SIGINT)
    try:
        process.wait(HANG_S)
    finally:
        process.kill()
    worked = ended_s() - before
    listener.join(HANG_S)
    text = "".join(said)
    assert "Traceback" not in text
    ended = (0,) if typed[0] == "teleop" else (130, -signal.SIGINT)  # a shell says 130 to both
    assert process.returncode in ended, text
    assert worked < ANSWER_S, f"{worked:.1f} s of the processor: {text}"
