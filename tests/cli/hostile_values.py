"""Values that nobody means and somebody types, for every key of every command.

All of them: ``python -m tests.cli.hostile_values FOLDER [PART/PARTS]``, which continues where it stopped and prints a
table; a share of them is in the tests.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import traceback
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import MISSING, fields
from pathlib import Path
from types import FrameType
from typing import NoReturn

from aerial_il.cli import commands
from aerial_il.cli.compose import compose
from aerial_il.cli.known import known
from aerial_il.cli.main import main
from aerial_il.core.errors import AerialError
from tests.safety.bounds import MAX_BYTES, MAX_CPU_S, peak

VALUES = (
    "", " ", "null", "nan", "inf", "-inf", "-1", "0", "1e400", "2.5", str(2**63), str(-(2**70)), "true", "no", "None",
    "[]", "[10]", "[[1]]", "[null]", "[-1,-1]", "{}", "{a:1}", "{a:{b:[1]}}", "[a", "{a", "(", "choice(1,2)",
    "${oc.env:HOME}", "${nowhere}", "${", "???", "'", '"', "\\", "a,b", "a=b", "a b", "数据", "ünï/ə", "\x00", "\n",
    "../../../etc/passwd", "/dev/null", "/dev/zero", "/proc/self/mem", "/root/\x01", "x" * 5000, "a/" * 500, "~",
    "$(touch owned)", "`touch owned`", ";ls", "%s%n", "-", "--help", "os:system", "builtins:exec", "1_000", "0x10",
    "1;2", "*", "@", "#", "\u202e", "\udcff",
)  # fmt: skip
DECLINED = ["robot=quad", "task=pick_place"]  # a cell that is declined: nothing long begins
BESIDE = {
    "collect": DECLINED, "demo": DECLINED, "teleop": [*DECLINED, "open=false", "port=0"],
    "film": ["out=film.webp", "flights=[quad/pick_place]"],
}  # fmt: skip
COMPOSED = ("bench", "docs", "doctor")  # begin at once whatever they are told
ANSWERED = ("refused", "failed", "done")
ANSWERS = {0: "done", 1: "failed", 2: "refused"}
MAX_WALL_S = 120
Case = tuple[str, str, str]


class TooSlowError(BaseException):
    """A command that does not answer."""


def cases() -> Iterator[Case]:
    """Yield command, key and value; keys of what a group holds by default are among them."""
    for name in commands.names():
        yield from ((name, key, value) for key in known(commands.find(name).settings, {}) for value in VALUES)


def typed(name: str, key: str, value: str) -> list[str]:
    """Return the words of a case: places that are not there stand in what else must be said."""
    needed = (f for f in fields(commands.find(name).settings) if f.default is f.default_factory is MISSING)
    wanted = [f.name for f in needed] + ["dataset"] * (name == "train")
    places = {name: f"{name}=nowhere" for name in wanted} | ({"kind": "kind=task"} if name == "new" else {})
    beside = [*places.values(), *BESIDE.get(name, [])]
    if name == "new":
        beside += ["into=new"]
    return [f"{key}={value}", *(word for word in beside if word.partition("=")[0] != key.partition(".")[0])]


def answered(name: str, key: str, value: str) -> bool:
    """Whether a case is answered in our words; whatever else is raised goes on."""
    return answer(name, key, value) in ANSWERS


def answer(name: str, key: str, value: str) -> int:
    """Return the exit status of a case, of those whose configuration alone is composed too."""
    words = typed(name, key, value)
    if not _only_composed(name, key, value):
        return main([name, *words])
    try:
        compose(commands.find(name), words)
    except AerialError:
        return 2
    return 0


def _only_composed(name: str, key: str, value: str) -> bool:
    unheld = {  # what holds the command back is what is tried, or it would write outside of the folder of these cases
        ("film", "flights"): True,
        ("list", "html"): value == "true",  # pictures of all robots and tasks
        ("teleop", "robot"): value == "null",
        ("teleop", "task"): value == "null",
        ("new", "into"): value == "null" or value.startswith("/root"),
    }
    return name in COMPOSED or unheld.get((name, key), False)


def every(share: int, first: int = 0) -> list[Case]:
    """Return one case of ``share``, spread over commands, keys and values."""
    return [case for number, case in enumerate(cases()) if number % share == first]


def outcome(case: Case) -> str:
    """Return how a case ends: ``refused``, ``failed`` or ``done`` as the exit status says, else what went wrong."""
    before, _ = peak(reset=True), signal.alarm(MAX_WALL_S)
    started = time.process_time()
    try:
        status = answer(*case)
        found = ANSWERS.get(status, f"status {status}")
    except TooSlowError:
        found = "slow"
    except BaseException as error:
        if isinstance(error, SystemExit) and error.code == 128 + signal.SIGTERM:
            raise  # the one who runs all this wants it to end
        place = traceback.extract_tb(error.__traceback__)[-1]
        found = f"untyped {type(error).__name__} {Path(place.filename).name}:{place.lineno}"
    finally:
        signal.alarm(0)
    if time.process_time() - started > MAX_CPU_S:
        return "slow"
    return "memory" if peak() - before > MAX_BYTES else found


def _too_slow(number: int, frame: FrameType | None) -> NoReturn:
    raise TooSlowError


def _child(folder: Path, part: int, parts: int) -> None:
    """Write the outcomes of the cases of one part that have none yet, one line each."""
    home = folder / f"part_{part}" / "in" / "its" / "own" / "place"
    home.mkdir(parents=True, exist_ok=True)
    done = {tuple(row[:3]) for row in _tried(folder)}
    signal.signal(signal.SIGALRM, _too_slow)
    out = _rows(folder, part, parts).open("a")
    os.chdir(home)
    sys.stdout = sys.stderr = open(os.devnull, "w", errors="backslashreplace")  # noqa: SIM115
    for case in (case for case in every(parts, part) if case not in done):
        (home / ".trying").write_text(json.dumps(case))
        found = outcome(case)
        if found in ("slow", "memory"):
            found = outcome(case)  # the first time may have paid for what is imported
        out.write(json.dumps([*case, "owned" if (home / "owned").exists() else found]) + "\n")
        out.flush()


def _rows(folder: Path, part: int, parts: int) -> Path:
    return folder / f"rows_{part}_of_{parts}.jsonl"


def _tried(folder: Path) -> list[list[str]]:
    """Return command, key, value and outcome of all cases so far, of whatever parts."""
    return [json.loads(line) for file in sorted(folder.glob("rows_*.jsonl")) for line in file.read_text().splitlines()]


def run(folder: Path, part: int, parts: int) -> int:
    """Try all cases of one part; print the table of the parts that are there; return how many were not answered."""
    folder.mkdir(parents=True, exist_ok=True)
    folder = folder.resolve()
    child = [sys.executable, "-m", "tests.cli.hostile_values", "--child", str(folder), str(part), str(parts)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([os.getcwd(), os.environ.get("PYTHONPATH", "")])}
    while ended := subprocess.run(child, env=environment, check=False).returncode:
        if ended in (-signal.SIGINT, 128 + signal.SIGINT, -signal.SIGTERM, 128 + signal.SIGTERM):
            sys.exit(ended)
        case = json.loads((folder / f"part_{part}" / "in" / "its" / "own" / "place" / ".trying").read_text())
        with _rows(folder, part, parts).open("a") as rows:
            rows.write(json.dumps([*case, f"died {ended}"]) + "\n")
    return table(folder)


def table(folder: Path) -> int:
    """Print command x outcome, and each case that was not answered; return the number of these."""
    found = _tried(folder)
    counts, keys = defaultdict[str, Counter[str]](Counter), defaultdict[str, set[str]](set)
    for name, key, _, said in found:
        counts[name][said if said in ANSWERED else "not answered"] += 1
        keys[name].add(key)
    columns = (*ANSWERED, "not answered")
    print(f"{'':10} {'keys':>5} {'tried':>6} " + " ".join(f"{name:>12}" for name in columns))
    for name, of in [*sorted(counts.items()), ("all", sum(counts.values(), Counter[str]()))]:
        many = sum(map(len, keys.values())) if name == "all" else len(keys[name])
        print(f"{name:10} {many:5} {of.total():6} " + " ".join(f"{of[column]:12}" for column in columns))
    wrong = [row for row in found if row[3] not in ANSWERED]
    for name, key, value, said in wrong:
        print(f"{name} {key}={value[:40]!a}: {said}")
    return len(wrong)


if __name__ == "__main__":
    if sys.argv[1] == "--child":
        _child(Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))
    else:
        of_all = (sys.argv[2:] or ["1/1"])[0].split("/")
        sys.exit(1 if run(Path(sys.argv[1]), int(of_all[0]) - 1, int(of_all[1])) else 0)
