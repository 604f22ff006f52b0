"""Trackers are told every row of the metrics once, by the files that their own tools read."""

import importlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aerial_il.algorithms.run import trackers
from aerial_il.algorithms.run.trackers import open_trackers, track_with
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.data.episode import Episode
from tests.algorithms.point_mass import demonstrations
from tests.algorithms.train_tiny import train

EARLIER = [{"step": 1, "loss": 3.0}, {"step": 2, "loss": 2.0, "validation/x_m": 0.5}]
LATER = {"step": 5, "loss": 1.0}
SEEN = [(1, "loss", 3.0), (2, "loss", 2.0), (2, "validation/x_m", 0.5), (5, "loss", 1.0)]


@pytest.fixture(scope="module")
def demos() -> list[Episode]:
    return demonstrations(12)


def tell(run: Path, *names: str) -> None:
    """Open a run that has reported before, and report once more."""
    with track_with(names):
        opened = open_trackers(run, EARLIER)
    for tracker in opened:
        tracker.write(LATER)
        tracker.close()


def events(run: Path) -> list[tuple[int, str, float]]:
    """Return what TensorBoard's files say, read by the framing that TensorFlow gives its records."""
    from tensorboardX.proto.event_pb2 import Event  # pyright: ignore[reportAttributeAccessIssue]

    result = []
    for file in sorted((run / "tensorboard").glob("events*")):
        raw, place = file.read_bytes(), 0
        while place < len(raw):
            length = int.from_bytes(raw[place : place + 8], "little")
            event = Event.FromString(raw[place + 12 : place + 12 + length])
            result += [(event.step, value.tag, value.simple_value) for value in event.summary.value]
            place += length + 16
    return result


def of_wandb(run: Path) -> list[tuple[int, str, float]]:
    """Return what the file of Weights & Biases' offline mode says, read by its own messages."""
    record: Any = importlib.import_module("wandb.proto.wandb_internal_pb2")
    (file,) = (run / "wandb").glob("offline-run-*/*.wandb")
    result = []
    for told in map(record.Record.FromString, leveldb_log(file.read_bytes())):
        values = {item.key or "/".join(item.nested_key): item.value_json for item in told.history.item}
        step = int(values.get("_step", 0))
        result += [(step, name, json.loads(text)) for name, text in values.items() if not name.startswith("_")]
    return result


def leveldb_log(raw: bytes) -> Iterator[bytes]:
    """Yield the records of a log in LevelDB's format: blocks of 32 KB; checksum, length and kind before each piece."""
    whole, last, block, place, record = 1, 4, 1 << 15, 7, b""  # the file's own mark is 7 bytes long
    while place + 7 <= len(raw):
        if block - place % block < 7:  # too little is left of the block for a head
            place += block - place % block
            continue
        length, kind = int.from_bytes(raw[place + 4 : place + 6], "little"), raw[place + 6]
        record += raw[place + 7 : place + 7 + length]
        place += 7 + length
        if kind in (whole, last):
            yield record
            record = b""


def of_mlflow(run: Path) -> list[tuple[int, str, float]]:
    mlflow: Any = importlib.import_module("mlflow")
    client = mlflow.MlflowClient(tracking_uri=(run / "mlruns").resolve().as_uri())
    experiment = client.get_experiment_by_name("aerial_il")
    (told,) = client.search_runs([experiment.experiment_id])
    assert (told.info.run_name, told.info.status) == (run.name, "FINISHED")
    history = (m for name in told.data.metrics for m in client.get_metric_history(told.info.run_id, name))
    return sorted((m.step, m.key, m.value) for m in history)


def test_tensorboard_is_told_what_was_reported_before_too(tmp_path: Path) -> None:
    for _ in range(2):  # opened again, it begins anew: nothing is told twice
        tell(tmp_path, "tensorboard")
        assert events(tmp_path) == SEEN


def test_wandb_offline_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("wandb", reason="pip install 'aerial-il[wandb]'")
    monkeypatch.setenv("WANDB_MODE", "offline")
    monkeypatch.setenv("WANDB_SILENT", "true")
    tell(tmp_path, "wandb")
    assert sorted(of_wandb(tmp_path)) == sorted(SEEN)


def test_mlflow_s_file_store_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mlflow", reason="pip install 'aerial-il[mlflow]'")
    for name in ("MLFLOW_TRACKING_URI", "MLFLOW_EXPERIMENT_NAME"):
        monkeypatch.delenv(name, raising=False)
    tell(tmp_path, "mlflow")
    assert of_mlflow(tmp_path) == sorted(SEEN)


def test_a_training_ends_in_the_same_weights_whoever_is_told(demos: list[Episode], tmp_path: Path) -> None:
    with track_with([]):
        untold = train(str(tmp_path / "untold"), demos)
    told = train(str(tmp_path / "told"), demos)
    assert not (tmp_path / "untold" / "tensorboard").exists()
    steps = [json.loads(line)["step"] for line in (tmp_path / "told" / "metrics.jsonl").read_text().splitlines()]
    assert sorted({step for step, _, _ in events(tmp_path / "told")}) == sorted(set(steps))
    for one, other in zip(untold.network.parameters(), told.network.parameters(), strict=True):
        np.testing.assert_array_equal(one.detach().numpy(), other.detach().numpy())


def test_a_tracker_that_is_unknown_or_not_installed_is_answered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(UnknownNameError, match="tensorboard"), track_with(["tensorbord"]):
        pass
    monkeypatch.setattr(trackers.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(InvalidValueError, match=r"pip install 'aerial-il\[wandb\]'"), track_with(["wandb"]):
        pass


def test_a_folder_of_a_tracker_s_name_is_no_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As those that Weights & Biases leaves in the working directory."""
    (tmp_path / "wandb").mkdir()
    monkeypatch.setattr("sys.path", [str(tmp_path)])
    monkeypatch.delitem(sys.modules, "wandb", raising=False)
    assert not trackers._installed("wandb")
