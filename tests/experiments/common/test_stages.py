"""Stages are kept by name and settings; demonstrations are as many as wanted; a training's time is told."""

import json
import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path

import pytest

from aerial_il.algorithms.run.folder import METRICS
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.folder import DEMOS, FAILURES
from experiments.common import demonstrations
from experiments.common.demonstrations import GENERATION_SEED, MOST_PER_DRAW, SEEDS_PER_DRAW, Generated, Source
from experiments.common.record import RECORD, Record, digest
from experiments.common.seeds import EVALUATION_SEED, TUNING_SEEDS
from experiments.common.stages import Stages, own_time_s, trained_s


def test_equal_settings_lie_in_one_place_and_others_elsewhere(tmp_path: Path) -> None:
    record = Record(tmp_path)
    place = record.place("training", "mlp/reach", {"steps": 10, "policy": {"chunk": 10}})
    assert record.place("training", "mlp/reach", {"policy": {"chunk": 10}, "steps": 10}) == place
    assert record.place("training", "mlp/reach", {"steps": 10, "policy": {"chunk": 20}}) != place
    assert digest({"a": 1}) != digest({"a": 2})


def test_a_stage_names_settings_commit_packages_and_machine(tmp_path: Path) -> None:
    made = json.loads((Record(tmp_path).place("training", "mlp", {"seed": 3}) / RECORD).read_text())
    assert made["settings"] == {"seed": 3}
    assert made["machine"]["cores"] >= 1
    assert {"mujoco", "torch"} <= set(made["packages"])
    assert "git" in made


def test_what_another_commit_made_counts_and_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file = Record(tmp_path).place("training", "mlp", {"seed": 3}) / RECORD
    made = json.loads(file.read_text())
    file.write_text(json.dumps({**made, "git": {"sha": "0123456789abcdef", "dirty": False}}))
    record = Record(tmp_path)
    assert record.notes() == []
    with caplog.at_level(logging.INFO):
        assert record.place("training", "mlp", {"seed": 3}) == file.parent
    assert "Results of commit 0123456789 are taken as they are; again=true makes them anew." in caplog.text
    assert record.notes() == ["Stages that were finished before were taken as they are, from commit 0123456789."]


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


SOURCE = Source(robot="fa_hexa_arm4", task="reach", draw=1)
FIRST = SOURCE.seed


def keep(out: Path, seed: int, kind: str) -> None:
    (out / kind).mkdir(parents=True, exist_ok=True)
    (out / kind / f"fa_hexa_arm4-reach-calm-{seed:06d}-00000000.mcap").touch()


def gather(out: Path, wanted: int, failing: Iterable[int] = ()) -> set[int]:
    """Gather demonstrations, of which each leaves an empty file: nothing is simulated. Return the seeds flown."""
    done = set[int]()

    def fly(flights: int) -> None:
        for seed in range(FIRST, FIRST + flights):
            done.add(seed)
            keep(out, seed, FAILURES if seed in failing else DEMOS)

    demonstrations.gather(out, wanted, FIRST, fly)
    return done


def test_a_failure_costs_one_more_flight(tmp_path: Path) -> None:
    failing = {FIRST + 3, FIRST + 10}
    assert gather(tmp_path, 10, failing) == set(range(FIRST, FIRST + 12))
    assert max(gather(tmp_path, 12, failing)) == FIRST + 13


def test_gaps_that_a_kill_left_are_filled(tmp_path: Path) -> None:
    for seed in range(FIRST, FIRST + 20):
        if seed != FIRST + 4:
            keep(tmp_path, seed, DEMOS)
    assert FIRST + 4 in gather(tmp_path, 10), "nineteen files are there, but not the first ten"


def test_flights_that_always_fail_are_noticed(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match="too many flights fail"):
        gather(tmp_path, 10, range(FIRST, FIRST + 100))


@pytest.mark.render
def test_demonstrations_are_generated_out_of_the_first_of_the_draw(tmp_path: Path) -> None:
    stages = Stages(record=Record(tmp_path), threads=1, progress=False)
    shown = Source(robot="fa_hexa_arm4", task="press_button", draw=1, cameras=("wrist",), image_size=(8, 8))
    made = stages.demonstrations(Generated(few=2, **asdict(shown)), 3, cameras=("wrist_rgb",))
    out_of = set(stages.demonstrations(shown, 2).uids)
    episodes = list(made)
    assert {episode.provenance["made_of"]["source"] for episode in episodes} <= out_of
    assert sorted(episode.seed for episode in episodes) == [GENERATION_SEED + shown.seed + k for k in range(3)]
    assert {episode.obs["wrist_rgb"].shape[1:] for episode in episodes} == {(8, 8, 3)}


def test_draws_and_evaluations_share_no_seed() -> None:
    with pytest.raises(InvalidValueError, match="at most 2500"):
        gather(Path("nowhere"), MOST_PER_DRAW + 1)
    assert 2 * MOST_PER_DRAW <= min(TUNING_SEEDS) < EVALUATION_SEED < SEEDS_PER_DRAW
    with pytest.raises(InvalidValueError, match="draws 0 to 9"):
        Source(robot="fa_hexa_arm4", task="reach", draw=10)
