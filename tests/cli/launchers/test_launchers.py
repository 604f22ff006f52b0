"""Every launcher there is gives the same table and the same weights, killed and continued or not."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from aerial_il.core import registry
from aerial_il.evaluation.run_collection import read_runs
from tests.patience import HANG_S

WORDS = ["train", "-m", "dataset=demos", "experiment=quick", "algorithm.steps=300", "policy.hidden=[16]", "seed=0,1"]
WORDS += [
    "algorithm.lr=0.001,0.0003",
    "evaluate_every=150",
    "evaluate_episodes=2",
    "algorithm.cadence.checkpoint_every=50",
]
WAYS = {
    "processes_1": ["launcher=processes", "launcher.jobs=1"],
    "processes_2": ["launcher=processes", "launcher.jobs=2"],
    "slurm": ["launcher=slurm", "launcher.hours=1"],
    "ray": ["launcher=ray", "launcher.jobs=2"],
}
CLOCK = ("elapsed_s", "wait_share")  # of a row of metrics: what no two runs share


def no_slurm() -> str:
    """Return why there is no SLURM to test with, empty if there is one."""
    if shutil.which("sinfo") is None:
        return "SLURM is not installed: make slurm (as root) installs and starts one"
    result = subprocess.run(["sinfo", "--noheader"], capture_output=True, text=True, check=False)
    return "SLURM does not answer: make slurm (as root) starts one" if result.returncode or not result.stdout else ""


def require(launcher: str) -> None:
    if launcher == "slurm" and (why := no_slurm()):
        pytest.skip(why)
    library = {"slurm": "submitit", "ray": "ray"}.get(launcher)
    if library and find_spec(library) is None:
        pytest.skip(f"{library} is not installed")


def command(*words: str) -> list[str]:
    return [sys.executable, "-m", "aerial_il", *words]


def table(sweep: Path) -> tuple[list[dict[str, Any]], list[str], list[list[dict[str, Any]]]]:
    """Return the rows of a sweep's table, the digests of its final weights, and all its metrics but the clock's."""
    result = read_runs(sweep)
    assert not result.refused
    weights = [sha256((run.path / "policy" / "arrays.safetensors").read_bytes()).hexdigest() for run in result.runs]
    metrics = [[{k: v for k, v in row.items() if k not in CLOCK} for row in run.rows] for run in result.runs]
    return result.rows, weights, metrics


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with demonstrations and a sweep over them, one run after the other."""
    folder = tmp_path_factory.mktemp("launchers")
    collected = command("collect", "task=reach", "episodes=6", "out=demos", "progress=false")
    subprocess.run(collected, cwd=folder, check=True, capture_output=True)
    subprocess.run(command(*WORDS, "run=serial"), cwd=folder, check=True, capture_output=True)
    return folder


def test_every_launcher_is_tested_here() -> None:
    assert {way.partition("_")[0] for way in WAYS} | {"serial"} == set(registry.names("launcher"))


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_launchers_give_identical_tables(way: str, home: Path) -> None:
    require(way.partition("_")[0])
    done = subprocess.run(
        command(*WORDS, f"run={way}", *WAYS[way]), cwd=home, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert table(home / way) == table(home / "serial")
    assert len(set(table(home / way)[1])) == 4


@pytest.mark.slow
@pytest.mark.parametrize("way", ["processes_2", "slurm", "ray"])
def test_a_sweep_killed_again_and_again_ends_the_same(way: str, home: Path) -> None:
    """The coordinator is killed three times, and a worker each time before."""
    require(way.partition("_")[0])
    words = command(*WORDS, f"run=killed_{way}", *WAYS[way])
    for patience_s in (4.0, 9.0, 14.0):
        sweep = subprocess.Popen(words, cwd=home, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(patience_s)
        for worker in workers(home / f"killed_{way}")[:1]:
            os.kill(worker, signal.SIGKILL)
        time.sleep(0.5)
        sweep.kill()
        sweep.wait()
    subprocess.run(words, cwd=home, capture_output=True, check=False)  # what a killed worker left may have failed
    done = subprocess.run(words, cwd=home, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert table(home / f"killed_{way}") == table(home / "serial")


def workers(sweep: Path) -> list[int]:
    """Return the processes that write to the logs of a sweep's jobs, the youngest first."""
    result = set()
    for link in Path("/proc").glob("[0-9]*/fd/1"):
        try:
            if Path(os.readlink(link)).is_relative_to(sweep):
                result.add(int(link.parts[2]))
        except OSError:
            continue
    return sorted(result, reverse=True)


@pytest.mark.slow
def test_a_job_whose_time_is_over_is_queued_again_and_goes_on(home: Path) -> None:
    """The signal is that of SLURM's own time limit; no checkpoint is due before, so that nothing else could save it."""
    require("slurm")
    words = [*WORDS[:3], "experiment=quick", "algorithm.steps=4000", "policy.hidden=[16]", "seed=choice(0)"]
    words += ["algorithm.cadence.checkpoint_every=100000", "algorithm.cadence.log_every=50"]
    timed = command(*words, "run=timed", "launcher=slurm", "launcher.hours=1")
    sweep = subprocess.Popen(timed, cwd=home, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    run = home / "timed" / "seed=0"
    while not (run / "metrics.jsonl").exists() or not (run / "metrics.jsonl").read_text():
        assert sweep.poll() is None
        time.sleep(0.1)
    number = json.loads((run / ".slurm" / "submitted.json").read_text())["job_id"]
    subprocess.run(["scancel", "--signal=USR2", number], check=True)
    said = sweep.communicate(timeout=HANG_S)[0]
    assert sweep.returncode == 0, said
    told = subprocess.run(["scontrol", "show", "job", number], capture_output=True, text=True, check=True).stdout
    assert "Restarts=1" in told
    assert len(re.findall(r"\| +0/4000 ", (run / "job.log").read_text())) == 1, "the second attempt went on"
    subprocess.run(command(*words, "run=untimed"), cwd=home, check=True, capture_output=True)
    assert table(home / "timed")[1:] == table(home / "untimed")[1:]


@pytest.mark.slow
def test_a_job_that_the_cluster_killed_does_not_stop_others(home: Path) -> None:
    require("slurm")
    words = command(*WORDS[:3], "experiment=quick", "algorithm.steps=3000", "seed=0,1", "run=cancelled", *WAYS["slurm"])
    sweep = subprocess.Popen(words, cwd=home, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    told = home / "cancelled" / "seed=0" / ".slurm" / "submitted.json"
    while not told.exists():
        assert sweep.poll() is None
        time.sleep(0.2)
    subprocess.run(["scancel", json.loads(told.read_text())["job_id"]], check=True)
    said = sweep.communicate(timeout=HANG_S)[0]
    assert sweep.returncode == 1
    assert re.search(r"seed=0 +failed .*died", said), said
    assert re.search(r"seed=1 +finished", said), said


@pytest.mark.parametrize(("launcher", "library"), [("slurm", "submitit"), ("ray", "ray")])
def test_a_launcher_that_is_not_installed_names_the_extra(launcher: str, library: str, tmp_path: Path) -> None:
    code = f"""
import sys
sys.modules[{library!r}] = None
import importlib.util
found = importlib.util.find_spec
importlib.util.find_spec = lambda name, *more: None if name == {library!r} else found(name, *more)
from aerial_il.cli.main import main
sys.exit(main(["collect", "-m", "task=reach", "out=o", "seed=0,1", "launcher={launcher}"]))
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "pip install 'aerial-il[cluster]'" in done.stderr
    assert "Traceback" not in done.stderr
