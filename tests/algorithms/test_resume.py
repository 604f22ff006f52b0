"""Whatever stops a run, the same command ends with the same bytes as if nothing had happened."""

import contextlib
import itertools
import logging
import os
import resource
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aerial_il.algorithms.run.folder import METRICS, REWARD, read_metrics
from aerial_il.algorithms.supervised.training_set import TrainingSet
from aerial_il.core import checkpoint
from aerial_il.core.errors import CheckpointError, InvalidValueError, TrainingDivergedError
from aerial_il.data.episode import Episode
from aerial_il.policies import load_policy
from tests.algorithms import train_tiny
from tests.algorithms.point_mass import demonstrations


@pytest.fixture(scope="module")
def demos() -> list[Episode]:
    return demonstrations(12)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, demos: list[Episode]) -> Path:
    """A run that nothing disturbed."""
    run = tmp_path_factory.mktemp("runs") / "whole"
    train_tiny.train(str(run), demos)
    return run


def start(run: Path) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "tests.algorithms.train_tiny", str(run)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def wait_for(child: subprocess.Popen[str], path: Path) -> None:
    while not path.exists() and child.poll() is None:
        time.sleep(0.005)


def saved_step(run: Path) -> int:
    result = checkpoint.latest(run)
    assert result is not None
    return result[1].state["parts"]["learner"]["step"]


def told(run: Path) -> list[dict[str, float]]:
    return [{k: v for k, v in row.items() if k not in ("elapsed_s", "wait_share")} for row in read_metrics(run)]


def assert_same_end(run: Path, whole: Path) -> None:
    for folder in (run / "policy", whole / "policy"):
        assert checkpoint.is_sealed(folder)
    assert (run / "policy" / checkpoint.ARRAYS).read_bytes() == (whole / "policy" / checkpoint.ARRAYS).read_bytes()
    assert told(run) == told(whole)


def kill_and_finish(run: Path, whole: Path, demos: list[Episode], rng: np.random.Generator, kills: int) -> None:
    ends = []
    for _ in range(kills):
        child = start(run)
        wait_for(child, run / METRICS)
        time.sleep(rng.uniform(0.0, 0.3))
        child.kill()
        child.communicate()
        ends.append(child.returncode)
    assert -signal.SIGKILL in ends, "every child finished before its kill; the test showed nothing"
    train_tiny.train(str(run), demos)
    assert_same_end(run, whole)


def test_killed_at_a_random_moment(tmp_path: Path, whole: Path, demos: list[Episode]) -> None:
    kill_and_finish(tmp_path / "run", whole, demos, np.random.default_rng(0), kills=1)


def test_sigterm_ends_a_process_with_143(tmp_path: Path, whole: Path, demos: list[Episode]) -> None:
    run = tmp_path / "run"
    child = start(run)
    wait_for(child, checkpoint.step_folder(run, 10))
    child.terminate()
    _, error = child.communicate()
    assert child.returncode == 143, error
    train_tiny.train(str(run), demos)
    assert_same_end(run, whole)


@pytest.mark.parametrize(("number", "raised"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, SystemExit)])
def test_a_signal_lets_the_step_end_and_saves_it(
    tmp_path: Path,
    whole: Path,
    demos: list[Episode],
    monkeypatch: pytest.MonkeyPatch,
    number: signal.Signals,
    raised: type[BaseException],
) -> None:
    """Sent in the middle of step 23, which no cadence touches."""
    honest = TrainingSet.gather

    def interrupted(self: TrainingSet, steps: np.ndarray) -> object:
        if len(steps) == train_tiny.SETTINGS.batch_size and next(count) == 23:
            os.kill(os.getpid(), number)
        return honest(self, steps)

    count, run, before = itertools.count(), tmp_path / "run", signal.getsignal(number)
    monkeypatch.setattr(TrainingSet, "gather", interrupted)
    with pytest.raises(raised) as caught:
        train_tiny.train(str(run), demos)
    assert getattr(caught.value, "code", None) == (143 if number == signal.SIGTERM else None)
    assert saved_step(run) == 24
    assert signal.getsignal(number) is before
    train_tiny.train(str(run), demos)
    assert_same_end(run, whole)


def test_a_signal_ends_an_evaluation_at_once(tmp_path: Path, whole: Path, demos: list[Episode]) -> None:
    """Its numbers are not lost: the resumed run evaluates the same weights first."""

    def interrupted(policy: object, step: int) -> dict[str, float]:
        os.kill(os.getpid(), signal.SIGTERM)
        raise AssertionError("still evaluating")

    with pytest.raises(SystemExit):
        train_tiny.train(str(tmp_path / "run"), demos, evaluate=interrupted)
    assert saved_step(tmp_path / "run") == 40
    train_tiny.train(str(tmp_path / "run"), demos)
    assert_same_end(tmp_path / "run", whole)


def test_running_a_finished_run_again_changes_nothing(whole: Path, demos: list[Episode]) -> None:
    files = [p for p in whole.rglob("*") if p.is_file() and p.suffix in (".safetensors", ".json", ".jsonl", ".yaml")]
    before = {p: p.read_bytes() for p in files if p.name != "provenance.json"}
    policy = train_tiny.train(str(whole), demos)
    assert policy.origin["step"] == 120
    assert {p: p.read_bytes() for p in before} == before


def test_a_damaged_checkpoint_is_passed_over(
    tmp_path: Path, whole: Path, demos: list[Episode], caplog: pytest.LogCaptureFixture
) -> None:
    run = tmp_path / "run"
    with contextlib.suppress(KeyboardInterrupt):
        train_tiny.train(str(run), demos, evaluate=_interrupt_at(80))
    newest = checkpoint.step_folder(run, 80) / checkpoint.ARRAYS
    newest.write_bytes(newest.read_bytes()[:-7])
    assert load_policy(run).config == train_tiny.POLICY
    assert load_policy(run).origin["step"] == 70
    with caplog.at_level(logging.WARNING):
        train_tiny.train(str(run), demos)
    assert str(newest) in caplog.text
    assert_same_end(run, whole)


def test_a_damaged_policy_is_rebuilt(tmp_path: Path, whole: Path, demos: list[Episode]) -> None:
    run = tmp_path / "run"
    train_tiny.train(str(run), demos)
    (run / "policy" / checkpoint.ARRAYS).write_bytes(b"")
    assert load_policy(run).origin["algorithm"] == "bc"
    train_tiny.train(str(run), demos)
    assert_same_end(run, whole)


def test_evaluation_does_not_touch_the_weights(tmp_path: Path, whole: Path, demos: list[Episode]) -> None:
    train_tiny.train(str(tmp_path / "run"), demos, evaluate=None)
    arrays = [(run / "policy" / checkpoint.ARRAYS).read_bytes() for run in (tmp_path / "run", whole)]
    assert arrays[0] == arrays[1]


def test_another_run_in_the_same_folder_is_refused(whole: Path, demos: list[Episode]) -> None:
    with pytest.raises(InvalidValueError, match="seed: 3 -> 4"):
        train_tiny.train(str(whole), demos, seed=4)
    with pytest.raises(InvalidValueError, match=r"settings\.lr: 0.001 -> 0.01"):
        train_tiny.train(str(whole), demos, settings=replace(train_tiny.SETTINGS, lr=0.01))
    with pytest.raises(InvalidValueError, match=r"dataset\.demonstrations: 12 -> 11"):
        train_tiny.train(str(whole), demos[:11])
    train_tiny.train(
        str(whole),
        demos,
        settings=replace(train_tiny.SETTINGS, cadence=replace(train_tiny.SETTINGS.cadence, log_every=9)),
    )


def test_starting_over_forgets_everything(tmp_path: Path, demos: list[Episode]) -> None:
    run = str(tmp_path / "run")
    train_tiny.train(run, demos, settings=replace(train_tiny.SETTINGS, steps=20))
    (tmp_path / "run" / REWARD).mkdir()
    policy = train_tiny.train(run, demos, settings=replace(train_tiny.SETTINGS, steps=10), resume=False)
    assert not (tmp_path / "run" / REWARD).exists(), "a reward of another run would be taken for this one's"
    assert policy.origin["step"] == 10
    assert read_metrics(run)[-1]["step"] == 10


def test_two_processes_cannot_share_a_folder(tmp_path: Path, demos: list[Episode]) -> None:
    def nested(policy: object, step: int) -> dict[str, float]:
        with pytest.raises(InvalidValueError, match="another process"):
            train_tiny.train(str(tmp_path / "run"), demos)
        return {}

    train_tiny.train(str(tmp_path / "run"), demos, evaluate=nested, settings=replace(train_tiny.SETTINGS, steps=5))


def test_a_full_disk_stops_the_run_and_spares_what_was_saved(tmp_path: Path, whole: Path, demos: list[Episode]) -> None:
    """A file size limit refuses writes as a full disk does; metrics stay below it, checkpoints do not."""
    run = tmp_path / "run"
    with contextlib.suppress(KeyboardInterrupt):
        train_tiny.train(str(run), demos, evaluate=_interrupt_at(40))
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, before[1]))
    try:
        with pytest.raises(CheckpointError, match=r"cannot be written .* run the same command again"):
            train_tiny.train(str(run), demos)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert saved_step(run) == 40
    train_tiny.train(str(run), demos)
    assert_same_end(run, whole)


def test_a_loss_that_is_not_finite_spoils_no_checkpoint(
    tmp_path: Path, demos: list[Episode], monkeypatch: pytest.MonkeyPatch
) -> None:
    from aerial_il.policies.mlp import MLPNetwork

    calls, honest = [0], MLPNetwork.loss

    def spoiled(self: MLPNetwork, *batch: object) -> object:
        loss, logged = honest(self, *batch)  # type: ignore[arg-type]
        calls[0] += 1
        return (loss * float("nan") if calls[0] == 24 else loss), logged

    monkeypatch.setattr(MLPNetwork, "loss", spoiled)
    settings = replace(train_tiny.SETTINGS, validation=0.0)
    with pytest.raises(TrainingDivergedError, match="step 23"):
        train_tiny.train(str(tmp_path / "run"), demos, settings=settings)
    result = checkpoint.latest(tmp_path / "run")
    assert result is not None
    assert saved_step(tmp_path / "run") == 20
    weights = [array for name, array in result[1].arrays.items() if "network" in name or "optimizer" in name]
    assert len(weights) > 8
    assert all(np.isfinite(array).all() for array in weights)


def test_all_checkpoints_damaged_is_an_error(tmp_path: Path, demos: list[Episode]) -> None:
    run = tmp_path / "run"
    with contextlib.suppress(KeyboardInterrupt):
        train_tiny.train(str(run), demos, evaluate=_interrupt_at(40))
    for folder in (run / checkpoint.FOLDER).iterdir():
        (folder / checkpoint.STATE).write_text("{}")
    with pytest.raises(CheckpointError, match="No other checkpoint is valid"):
        train_tiny.train(str(run), demos)


def _interrupt_at(wanted: int) -> object:
    def evaluate(policy: object, step: int) -> dict[str, float]:
        if step == wanted:
            raise KeyboardInterrupt
        return dict(train_tiny.evaluate(policy, step))

    return evaluate
