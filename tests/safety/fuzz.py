"""Mutated files by the thousand: each is refused by a typed error, or read with every value as it was.

``make fuzz`` runs all of it into ``runs/fuzz``, continues where it stopped, and prints a table; the tests run a share.
``python -m tests.safety.fuzz FOLDER mcap=500`` runs so many of one kind. Each kind is read in a process of its own, so
that one that dies is a row of the table, too.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

import numpy as np

import aerial_il
from aerial_il.algorithms.run.folder import read_metrics
from aerial_il.collection.collect import collect
from aerial_il.core.checkpoint import digest
from aerial_il.core.errors import AerialError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.formats import lerobot, robomimic
from aerial_il.data.formats.parts import hdf5_probe
from aerial_il.data.formats.parts.content_digest import content_digest
from tests.algorithms.train_tiny import train
from tests.data.crane import CraneBatch, CraneExpert
from tests.data.recording.test_damage import mutate
from tests.safety.bounds import MAX_BYTES, MAX_CPU_S, peak

ALL = {"mcap": 10_000, "lerobot": 2_000, "hdf5": 2_000, "run": 2_000}
MUTATIONS = ("bit", "bytes", "zeros", "insert", "delete", "swap")
GOOD = ("refused", "identical", "unsealed")
UNSEALED = ("metrics.jsonl", "config.yaml", "provenance.json")  # of a run: text for people, that they may change


class TooSlowError(Exception):
    """A reader that does not answer."""


@dataclass(frozen=True)
class Target:
    """A sound file or folder, and what reading it gives.

    Attributes:
        path: where it lies. read: its content as plain values that can be compared.
    """

    path: Path
    read: Callable[[Path], Any]


def sound(home: Path) -> dict[str, Target]:
    """Return what is mutated, made once in ``home``."""
    mcap, folder, hdf5, run = home / "mcap", home / "lerobot", home / "demos.hdf5", home / "run"
    if not (home / "whole").exists():
        shutil.rmtree(home, ignore_errors=True)
        home.mkdir(parents=True)
        dataset = collect(CraneBatch(3), CraneExpert(), range(3), home / "dataset", progress=False).folder
        shutil.copyfile(dataset.files()[0], mcap)
        recorded = open_dataset(dataset.path)
        lerobot.write(recorded, folder)
        robomimic.write(recorded, hdf5)
        train(str(run))
        (home / "whole").touch()
    return {
        "mcap": Target(mcap, _episodes), "lerobot": Target(folder, _episodes),
        "hdf5": Target(hdf5, _episodes), "run": Target(run, _run),
    }  # fmt: skip


def outcome(kind: str, number: int, target: Target, whole: Any, scratch: Path) -> str:
    """Return what comes of mutation ``number`` of a target, and of which error where it is untyped."""
    rng = np.random.default_rng([number, *kind.encode()])
    mutated, changed = _mutated(target.path, scratch, rng)
    before, _ = peak(reset=True), signal.alarm(60)
    started = time.process_time()
    try:
        result = target.read(mutated)
        found = "identical" if result == whole else "unsealed" if changed in UNSEALED else "changed"
    except AerialError:
        found = "refused"
    except TooSlowError:
        found = "slow"
    except Exception as error:
        found = f"untyped {type(error).__name__}"
    finally:
        signal.alarm(0)
    if time.process_time() - started > MAX_CPU_S:
        found = "slow"
    return "memory" if peak() - before > MAX_BYTES else found


def outcomes(kind: str, numbers: range, target: Target, scratch: Path) -> Iterator[tuple[int, str]]:
    """Yield number and outcome of mutations."""
    signal.signal(signal.SIGALRM, _too_slow)
    alone = scratch / "whole" / f"{target.path.stem}.mcap"  # a recording goes by the name of its file
    whole = target.read(target.path if kind != "mcap" else _copy(target.path, alone))
    for number in numbers:
        yield number, outcome(kind, number, target, whole, scratch)


def _episodes(path: Path) -> Any:
    return {episode.uid: content_digest(episode) for episode in open_dataset(path, strict=True)}


def _run(path: Path) -> Any:
    policy: Any = aerial_il.load_policy(str(path))
    return digest(policy.to_checkpoint()), read_metrics(path)


def _mutated(source: Path, scratch: Path, rng: np.random.Generator) -> tuple[Path, str]:
    """Return a copy of a file or folder of which one file is changed, and that file's name."""
    copy = scratch / f"{source.stem}{source.suffix or ('.mcap' if source.is_file() else '')}"
    shutil.rmtree(copy, ignore_errors=True)
    if source.is_file():
        victim = copy
        raw = source.read_bytes()
    else:
        shutil.copytree(source, copy)
        files = sorted(f for f in copy.rglob("*") if f.is_file() and f.stat().st_size and "events" not in f.name)
        victim = files[rng.integers(len(files))]
        raw = victim.read_bytes()
    victim.write_bytes(mutate(raw, str(rng.choice(MUTATIONS)), rng))
    return copy, victim.name


def _copy(source: Path, target: Path) -> Path:
    target.parent.mkdir(parents=True, exist_ok=True)
    return Path(shutil.copyfile(source, target))


def _too_slow(number: int, frame: FrameType | None) -> NoReturn:
    raise TooSlowError


def look_at(paths: Iterable[Path]) -> None:
    """Probe as ``hdf5_probe`` does, in copies of this process, which has imported all, instead of one that is new."""
    for path in paths:
        child = os.fork()
        if not child:
            try:
                held, limit = int(Path("/proc/self/statm").read_text().split()[0]), hdf5_probe.MAX_BYTES
                most = held * os.sysconf("SC_PAGESIZE") + limit
                program = hdf5_probe.PROBE.replace(f"({limit}, {limit})", f"({most}, {most})")
                exec(program + "probe(path)", {"path": path})
            finally:
                os._exit(0)
        hdf5_probe.ended[hdf5_probe.known_by(path)] = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def _child(home: Path, kind: str, first: int, last: int) -> None:
    """Write the outcomes of some mutations, one line each."""
    hdf5_probe.look_at = look_at  # type: ignore[assignment]
    scratch = home / f"scratch_{kind}"
    scratch.mkdir(exist_ok=True)
    with open(home / f"{kind}.jsonl", "a") as rows:
        for number, found in outcomes(kind, range(first, last), sound(home / "sound")[kind], scratch):
            rows.write(json.dumps([number, found]) + "\n")
            rows.flush()


def _told(home: Path, kind: str) -> list[str]:
    """Return the outcomes so far, in order."""
    file = home / f"{kind}.jsonl"
    return [json.loads(line)[1] for line in file.read_text().splitlines()] if file.exists() else []


def run(home: Path, wanted: dict[str, int]) -> int:
    """Try mutations until there are as many of each kind as wanted; print the table; return how many went wrong."""
    home.mkdir(parents=True, exist_ok=True)
    sound(home / "sound")
    for kind, count in wanted.items():
        while (done := len(_told(home, kind))) < count:
            child = [sys.executable, "-m", "tests.safety.fuzz", "--child", str(home), kind, str(done), str(count)]
            ended = subprocess.run(child, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False).returncode
            if ended:
                with open(home / f"{kind}.jsonl", "a") as rows:
                    rows.write(json.dumps([len(_told(home, kind)), f"died {ended}"]) + "\n")
    found = {kind: Counter(_told(home, kind)) for kind in wanted}
    columns = [*GOOD, *sorted({name for counts in found.values() for name in counts} - {*GOOD})]
    print(f"{'':8} {'tried':>7} " + " ".join(f"{name:>10}" for name in columns))
    for kind, counts in found.items():
        print(f"{kind:8} {counts.total():7} " + " ".join(f"{counts[name]:10}" for name in columns))
    return sum(count for counts in found.values() for name, count in counts.items() if name not in GOOD)


if __name__ == "__main__":
    if sys.argv[1] == "--child":
        _child(Path(sys.argv[2]), sys.argv[3], int(sys.argv[4]), int(sys.argv[5]))
    else:
        asked = dict(word.split("=") for word in sys.argv[2:])
        sys.exit(1 if run(Path(sys.argv[1]), {kind: int(n) for kind, n in asked.items()} or ALL) else 0)
