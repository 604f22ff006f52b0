"""A run that is another is told by the settings that differ; digests are put into words."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from aerial_il.algorithms.run.folder import RunFolder
from aerial_il.core.checkpoint import Checkpoint
from aerial_il.core.errors import InvalidValueError

ONE, OTHER = "1a" * 32, "2b" * 32
BEGUN: Mapping[str, Any] = {
    "seed": 3,
    "dataset": {"demonstrations": 10, "frames": 900, "digest": ONE},
    "prior": ONE,
    "settings": {"lr": 0.001, "prior": "runs/first"},
    "policy": {"name": "mlp", "chunk": 20},
}


def refusal(folder: Path, changed: Mapping[str, Any]) -> str:
    """Return how a run with some other values, key -> value or mapping, is refused where that of ``BEGUN`` is."""
    parts = {key: {**BEGUN[key], **new} if isinstance(new, dict) else new for key, new in changed.items()}
    with pytest.raises(InvalidValueError) as caught, RunFolder.open(folder, {**BEGUN, **parts}):
        pass
    return str(caught.value)


@pytest.fixture
def begun(tmp_path: Path) -> Path:
    with RunFolder.open(tmp_path, BEGUN) as run:
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
    begun: Path, changed: dict[str, Any], said: str
) -> None:
    told = refusal(begun, changed)
    assert said in told
    assert "Choose another run=NAME or resume=false" in told
    assert ONE not in told
    assert OTHER not in told


def test_the_dataset_of_then_is_named_where_the_folder_knows_it(begun: Path) -> None:
    (begun / "command.json").write_text(json.dumps({"dataset": {"path": "datasets/a", "episodes": None}}))
    assert "the demonstrations of 'datasets/a' -> others" in refusal(begun, {"dataset": {"digest": OTHER}})


@pytest.mark.parametrize("damaged", ["{", "[]", '{"dataset": null}', '{"dataset": {"path": 5}}'])
def test_a_command_that_cannot_be_read_hides_nothing(begun: Path, damaged: str) -> None:
    (begun / "command.json").write_text(damaged)
    assert "the demonstrations of then -> others" in refusal(begun, {"dataset": {"digest": OTHER}})
