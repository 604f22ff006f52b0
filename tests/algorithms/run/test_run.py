"""Runs: another one in the same folder is refused by the settings that differ; signals wait for a step to end."""

import json
import os
import signal
import threading
from collections.abc import Mapping
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import pytest
import yaml

import aerial_il
from aerial_il.algorithms.run.folder import CONFIG, PROVENANCE, RunFolder, flown_in
from aerial_il.algorithms.run.signals import SignalWatch
from aerial_il.core import checkpoint
from aerial_il.core.checkpoint import Checkpoint
from aerial_il.core.errors import InvalidValueError

ONE, OTHER = "1a" * 32, "2b" * 32
STARTED: Mapping[str, Any] = {
    "seed": 3,
    "dataset": {"demonstrations": 10, "frames": 900, "digest": ONE},
    "prior": ONE,
    "settings": {"lr": 0.001, "prior": "runs/first"},
    "policy": {"name": "mlp", "chunk": 20},
}


def refusal(folder: Path, changed: Mapping[str, Any]) -> str:
    """Return how a run with some other values, key -> value or mapping, is refused where that of ``STARTED`` is."""
    parts = {key: {**STARTED.get(key, {}), **new} if isinstance(new, dict) else new for key, new in changed.items()}
    with pytest.raises(InvalidValueError) as caught, RunFolder.open(folder, {**STARTED, **parts}):
        pass
    return str(caught.value)


@pytest.fixture
def started(tmp_path: Path) -> Path:
    with RunFolder.open(tmp_path, STARTED) as run:
        run.save(1, Checkpoint({}, {}, {}), keep=1)
    return tmp_path


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"seed": 4}, "(seed: 3 -> 4)"),
        ({"settings": {"lr": 0.01}}, "(settings.lr: 0.001 -> 0.01)"),
        ({"settings": {"ema": 0.9}}, "(settings.ema: not set -> 0.9)"),
        ({"policy": {"chunk": 10}, "dataset": {"digest": OTHER}}, "(policy.chunk: 20 -> 10)"),
        (
            {"dataset": {"demonstrations": 20, "frames": 1800, "digest": OTHER}},
            "(dataset.demonstrations: 10 -> 20; dataset.frames: 900 -> 1800)",
        ),
        ({"dataset": {"digest": OTHER}}, "(dataset: the demonstrations of then -> others, as many and as long)"),
        ({"prior": OTHER}, "(prior: the weights of then -> other weights)"),
        ({"prior": None}, "(prior: the weights of then -> none)"),
    ],
)
def test_settings_are_told_by_their_values_and_contents_in_words(
    started: Path, changed: dict[str, Any], said: str
) -> None:
    message = refusal(started, changed)
    assert said in message
    assert "Choose another run=NAME or resume=false" in message
    assert ONE not in message
    assert OTHER not in message


def test_the_dataset_of_then_is_named_where_the_folder_knows_it(started: Path) -> None:
    (started / "command.json").write_text(json.dumps({"dataset": {"path": "datasets/a", "episodes": None}}))
    assert "the demonstrations of 'datasets/a' -> others" in refusal(started, {"dataset": {"digest": OTHER}})


@pytest.mark.parametrize("damaged", ["{", "[]", '{"dataset": null}', '{"dataset": {"path": 5}}'])
def test_a_command_that_cannot_be_read_hides_nothing(started: Path, damaged: str) -> None:
    (started / "command.json").write_text(damaged)
    assert "the demonstrations of then -> others" in refusal(started, {"dataset": {"digest": OTHER}})


NOW: dict[str, Any] = {"settings": {"steps": 10, "replay": {"capacity": 5}}}


def old_run(run: Path, settings: dict[str, Any]) -> Path:
    """Leave a folder in which a run with these settings has taken a checkpoint."""
    (run / checkpoint.FOLDER).mkdir(parents=True)
    (run / CONFIG).write_text(yaml.safe_dump({"settings": settings}))
    (run / PROVENANCE).write_text('{"packages": {"aerial-il": "0.1.0"}}')
    return run


def test_a_run_of_an_earlier_version_is_refused_by_its_keys(tmp_path: Path) -> None:
    run = old_run(tmp_path, {"steps": 10, "buffer_size": 5})
    with (
        pytest.raises(InvalidValueError, match=r"earlier version.*settings\.buffer_size.*resume=false"),
        RunFolder.open(run, NOW),
    ):
        pass


def send(number: signal.Signals) -> None:
    os.kill(os.getpid(), number)


def test_the_first_signal_is_remembered_and_the_second_one_stops() -> None:
    with SignalWatch() as watch:
        assert watch.pending is None
        send(signal.SIGTERM)
        assert watch.pending == signal.SIGTERM
        with pytest.raises(KeyboardInterrupt):
            send(signal.SIGINT)


def test_each_signal_leaves_in_its_own_way() -> None:
    with SignalWatch() as watch:
        send(signal.SIGTERM)
        with pytest.raises(SystemExit) as caught:
            watch.stop()
    assert caught.value.code == 143


def test_a_signal_stops_long_work_before_and_during_it() -> None:
    with SignalWatch() as watch:
        with pytest.raises(KeyboardInterrupt), watch.at_once():
            send(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt), watch.at_once():
            raise AssertionError("begun")


def test_handlers_come_back_and_other_threads_are_left_alone() -> None:
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    with SignalWatch():
        assert signal.getsignal(signal.SIGINT) is not before[0]
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)] == before
    seen: list[int | None] = []

    def elsewhere() -> None:
        with SignalWatch() as watch:
            seen.append(watch.pending)

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert seen == [None]


def test_another_time_limit_is_another_run_and_what_earlier_versions_did_not_keep_is_not_compared(
    started: Path,
) -> None:
    """Of an environment, they kept less: they go on, and what is there now is kept from then on."""
    with ExitStack() as stack:
        long, short = (
            flown_in(stack.enter_context(closing(aerial_il.load_batch("quad", "hover", num_envs=1, horizon=horizon))))
            for horizon in (None, 250)
        )
    assert (long["max_steps"], long["ends_at_success"]) == (1000, True)
    assert (short["max_steps"], short["ends_at_success"]) == (250, False)
    with RunFolder.open(started, {**STARTED, "environment": long}):
        pass
    assert "environment.max_steps: 1000 -> 250" in refusal(started, {"environment": short})
