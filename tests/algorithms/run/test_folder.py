"""A run's folder takes up only what it can go on with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from aerial_il.algorithms.run.folder import CONFIG, RunFolder
from aerial_il.core import checkpoint
from aerial_il.core.errors import InvalidValueError

NOW: dict[str, Any] = {"settings": {"steps": 10, "replay": {"capacity": 5}}}


def begun(run: Path, settings: dict[str, Any]) -> Path:
    """Leave a folder in which a run with these settings has taken a checkpoint."""
    (run / checkpoint.FOLDER).mkdir(parents=True)
    (run / CONFIG).write_text(yaml.safe_dump({"settings": settings}))
    return run


def test_a_run_of_an_earlier_version_is_refused_by_its_keys(tmp_path: Path) -> None:
    run = begun(tmp_path, {"steps": 10, "buffer_size": 5})
    with (
        pytest.raises(InvalidValueError, match=r"earlier version.*settings\.buffer_size.*resume=false"),
        RunFolder.open(run, NOW),
    ):
        pass


def test_another_run_is_refused_by_what_differs(tmp_path: Path) -> None:
    run = begun(tmp_path, {"steps": 20, "replay": {"capacity": 5}})
    with (
        pytest.raises(InvalidValueError, match=r"holds another run \(settings\.steps: 20 -> 10"),
        RunFolder.open(run, NOW),
    ):
        pass
