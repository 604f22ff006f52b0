"""How long a training took, as its metrics tell: a row that tells nothing must not meet a limit of time."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from aerial_il.algorithms.run.folder import METRICS
from experiments.common.stages import own_time_s, trained_s


def told(run: Path, rows: Sequence[Mapping[str, float]]) -> Path:
    run.mkdir(parents=True)
    (run / METRICS).write_text("".join(f"{json.dumps(dict(row))}\n" for row in rows))
    return run


def test_a_last_row_of_flights_alone_does_not_hide_the_time(tmp_path: Path) -> None:
    run = told(
        tmp_path / "run",
        [{"step": 0, "evaluate/success": 0.5}, {"step": 9, "elapsed_s": 70.0}, {"step": 9, "evaluate/success": 1.0}],
    )
    assert own_time_s(run) == trained_s(run) == 70.0


def test_the_start_counts_and_rounds_count_once(tmp_path: Path) -> None:
    run = told(tmp_path / "run", [{"step": 1, "elapsed_s": 100.0}])
    told(run / "prior", [{"step": 5, "elapsed_s": 20.0}])
    told(run / "rounds" / "001" / "training", [{"step": 5, "elapsed_s": 40.0}])
    assert trained_s(run) == 120.0


def test_rounds_count_where_the_run_tells_no_time(tmp_path: Path) -> None:
    run = told(tmp_path / "run", [{"step": 1, "flights": 3.0}])
    told(run / "rounds" / "001" / "training", [{"step": 5, "elapsed_s": 40.0}])
    assert own_time_s(run) == 0.0
    assert trained_s(run) == 40.0
