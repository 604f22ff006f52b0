"""Sweeps: what becomes of their jobs, whichever of them fails, is killed, or is done by somebody else already."""

import os
import signal
import subprocess
import sys
import threading
import time
from hashlib import sha256
from pathlib import Path

import pytest

from aerial_il.cli import compose
from aerial_il.cli.commands import find
from aerial_il.cli.launchers import processes, serial
from aerial_il.cli.main import main
from aerial_il.cli.sweeps import job as jobs_of
from aerial_il.cli.sweeps.board import Board
from aerial_il.cli.sweeps.job import Job
from aerial_il.cli.sweeps.sweep import chosen_of
from aerial_il.cli.words import LAUNCHER, read
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from tests.patience import HANG_S

pytestmark = pytest.mark.usefixtures("no_commit")
HOVER = ("robot=quad", "task=hover", "progress=false", "num_envs=2")


def collect(folder: Path, *more: str) -> Job:
    return Job("collect", (*HOVER, *more, f"out='{folder}'"), str(folder))


def digests(folder: Path) -> dict[str, str]:
    """Return each recording of a dataset with its SHA-256; there must be some."""
    result = {file.name: sha256(file.read_bytes()).hexdigest() for file in sorted(folder.glob("demos/*.mcap"))}
    assert result
    return result


@pytest.mark.parametrize("abreast", [2, pytest.param(1, marks=pytest.mark.slow)])
def test_launchers_give_the_same_bytes(tmp_path: Path, abreast: int) -> None:
    result = []
    for name, launcher in (("serial", serial.Serial()), ("processes", processes.Processes(jobs=abreast))):
        jobs = [collect(tmp_path / name / f"seed={seed}", "episodes=2", f"seed={seed}") for seed in (0, 2)]
        board = Board(jobs)
        launcher.launch(jobs, board)
        assert [outcome.state for outcome in board.outcomes.values()] == ["finished"] * 2, board.table()
        result.append([digests(Path(job.folder)) for job in jobs])
    assert result[0] == result[1]
    assert result[0][0] != result[0][1]


def test_a_job_that_is_killed_or_wrong_does_not_stop_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(job: Job, **limits: int) -> subprocess.Popen[bytes]:
        process = jobs_of.start(job, **limits)
        if job.name == "killed":
            process.kill()
        return process

    monkeypatch.setattr(processes, "start", killed)
    jobs = [
        collect(tmp_path / "killed", "episodes=1"),
        collect(tmp_path / "wrong", "episodes=-1"),
        collect(tmp_path / "right", "episodes=1"),
    ]
    board = Board(jobs)
    processes.Processes(jobs=2).launch(jobs, board)
    assert [board.outcomes[job].status for job in jobs] == [-signal.SIGKILL, 2, 0]
    assert "SIGKILL" in board.outcomes[jobs[0]].reason
    assert "episodes=-1" in board.outcomes[jobs[1]].reason
    assert board.status == 1
    assert "not run" not in board.table()


def test_a_folder_that_cannot_be_written_stops_no_other_job(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("not a folder")
    jobs = [
        collect(tmp_path / ("x" * 300)),
        collect(tmp_path / "file" / "below"),
        collect(tmp_path / "ok", "episodes=1"),
    ]
    board = Board(jobs)
    processes.Processes(jobs=2).launch(jobs, board)
    assert [board.outcomes[job].status for job in jobs] == [2, 2, 0]
    assert "cannot be written: File name too long" in board.outcomes[jobs[0]].reason
    assert "cannot be written: Not a directory" in board.outcomes[jobs[1]].reason


def test_the_reason_is_that_of_the_last_attempt(tmp_path: Path) -> None:
    job = collect(tmp_path / "job", "episodes=-1")
    jobs_of.start(job, threads=1, cores=1).wait(HANG_S)
    assert "episodes=-1" in job.complaint()
    again = Job(job.command, (*job.overrides[:-2], "episodes=0", job.overrides[-1]), job.folder)
    jobs_of.start(again, threads=1, cores=1).wait(HANG_S)
    assert "episodes=-1" not in again.complaint()
    assert "episodes=0" in again.complaint()


@pytest.mark.slow
def test_a_killed_sweep_leaves_no_job_and_is_continued(tmp_path: Path) -> None:
    words = ["collect", "-m", *HOVER, "episodes=40", "seed=0,40", "out=sweep", "launcher=processes", "launcher.jobs=2"]
    command = [sys.executable, "-m", "aerial_il", *words]
    sweep = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    folders = [tmp_path / "sweep" / f"seed={seed}" for seed in (0, 40)]
    deadline = time.monotonic() + HANG_S
    while not all(len(list(folder.glob("demos/*.mcap"))) >= 2 for folder in folders):
        assert sweep.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    sweep.kill()
    sweep.wait()
    assert any(len(digests(folder)) < 40 for folder in folders), "it was killed too late to tell anything"
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert [len(digests(folder)) for folder in folders] == [40, 40]
    whole = tmp_path / "whole"
    subprocess.run([sys.executable, "-m", "aerial_il", "collect", *HOVER, "episodes=40", f"out={whole}"], check=True)
    assert digests(folders[0]) == digests(whole)


def test_the_same_job_is_not_done_twice_at_a_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jobs_of, "PATIENCE_S", 0.0)
    job = collect(tmp_path / "one", "episodes=200")
    first = jobs_of.start(job, threads=1, cores=1)
    with pytest.raises(InvalidValueError, match="another process"):
        jobs_of.start(job, threads=1, cores=1)
    jobs_of.stop([first])
    assert first.returncode in (-signal.SIGTERM, 128 + signal.SIGTERM)
    jobs_of.stop([jobs_of.start(job, threads=1, cores=1)])


def test_ctrl_c_stops_the_jobs_and_says_how_to_continue(tmp_path: Path) -> None:
    words = ["collect", "-m", *HOVER, "episodes=5000", "seed=0,5000", "out=s", "launcher=processes", "launcher.jobs=2"]
    command = [sys.executable, "-m", "aerial_il", *words]
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # tests in the background would pass on: ignored
    try:
        sweep = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    finally:
        signal.signal(signal.SIGINT, before)
    assert sweep.stderr is not None
    while "seed=5000: started" not in sweep.stderr.readline():
        assert sweep.poll() is None
    time.sleep(0.5)
    sweep.send_signal(signal.SIGINT)
    said = sweep.communicate(timeout=HANG_S)[1]
    assert sweep.returncode == 128 + signal.SIGINT
    assert f"Continue: aerial-il {' '.join(words)}" in said
    logs = [str(file) for file in tmp_path.glob("s/*/job.log")]
    assert len(logs) == 2
    assert not [file for log in logs for file in open_files() if file == log]


def open_files() -> list[str]:
    """Return the files that any process of ours has open."""
    result = []
    for link in Path("/proc").glob("[0-9]*/fd/*"):
        try:
            result.append(os.readlink(link))
        except OSError:
            continue
    return result


def test_words_choose_a_launcher() -> None:
    typed = ["-m", "launcher=processes", "launcher.jobs=3", "seed=0,1", "run=x"]
    said = read(find("train"), typed)
    assert said.overrides == ("seed=0,1", "run=x")
    assert chosen_of(LAUNCHER, said.apart[LAUNCHER]) == processes.Processes(jobs=3)
    assert chosen_of(LAUNCHER, {}) == serial.Serial()
    with pytest.raises(UnknownNameError, match="Did you mean 'processes'"):
        chosen_of(LAUNCHER, {"launcher": "process"})
    with pytest.raises(UnknownNameError, match=r"Did you mean 'launcher\.jobs'"):
        chosen_of(LAUNCHER, {"launcher": "processes", "launcher.job": "3"})
    with pytest.raises(InvalidValueError, match="jobs='many'"):
        chosen_of(LAUNCHER, {"launcher": "processes", "launcher.jobs": "many"})
    with pytest.raises(InvalidValueError, match="jobs=-1"):
        chosen_of(LAUNCHER, {"launcher": "processes", "launcher.jobs": "-1"})


def test_a_launcher_needs_a_sweep(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "run=x", "launcher=processes"]) == 2
    assert "add -m" in capsys.readouterr().err


def test_a_job_ends_with_the_process_that_started_it(tmp_path: Path) -> None:
    job = collect(tmp_path / "orphan", "episodes=5000")
    process = jobs_of.start(job, threads=1, cores=1)
    while not list(Path(job.folder).glob("**/*.part")):
        assert process.poll() is None
        time.sleep(0.05)
    assert process.stdin is not None
    threading.Timer(0.1, process.stdin.close).start()  # as the kernel does for a killed process
    assert process.wait(HANG_S) != 0


def test_a_value_with_a_slash_is_no_path_of_folders() -> None:
    points = compose.points(find("train"), ["dataset.path=a/x,b/x", "run=runs/sweep"])
    assert [folder for _, folder in points] == ["runs/sweep/dataset.path=a-x", "runs/sweep/dataset.path=b-x"]
    alike = compose.points(find("train"), ["dataset.path=a-b,a/b", "run=runs/sweep"])
    assert [folder for _, folder in alike] == ["runs/sweep/dataset.path=a-b", "runs/sweep/dataset.path=a-b,1"]


def test_null_is_swept_as_such() -> None:
    typed = read(find("train"), ["-m", "policy.anchor=null,ee_pos", "dataset=d", "run=r"]).overrides
    tried = [point[0] for point, _ in compose.points(find("train"), typed)]
    assert tried == ["policy.anchor=null", "policy.anchor=ee_pos"]
