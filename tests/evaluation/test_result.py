"""Results keep their keys and compare; runs below a folder are found, filtered and sorted."""

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.evaluation import statistics
from aerial_il.evaluation.compare import compare, p_value_text
from aerial_il.evaluation.result import SCHEMA, EvaluationResult, load_result, simplified
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.evaluation.run_collection import RunCollection, read_runs
from tests.data.crane import CraneBatch, CraneExpert, crane_spec
from tests.presentation.pages.test_run_report import make_run


def fly(seeds: Any, *, dive: bool = False, **origin: Any) -> EvaluationResult:
    name = "diver" if dive else "expert"
    return evaluate(CraneBatch(16), CraneExpert(dive=dive), seeds, policy_name=name, origin=origin, progress=False)


def test_json_has_the_keys_that_others_rely_on(diver: EvaluationResult, tmp_path: Path) -> None:
    raw = json.loads(diver.save(tmp_path).read_text())
    assert list(raw) == [
        *("schema", "robot", "task", "tier", "policy", "episodes", "seeds", "success", "return", "metrics"),
        *("per_episode", "provenance"),
    ]
    assert (raw["schema"], raw["episodes"], raw["seeds"]) == (SCHEMA, 40, [100, 139])
    assert list(raw["success"]) == ["count", "rate", "ci95"]
    assert len(raw["per_episode"]) == 40
    assert raw["provenance"]["command"] == "aerial-il evaluate policy=diver"
    assert raw["provenance"]["environment"]["control_dt_s"] == crane_spec().control_dt_s


def test_a_result_survives_its_file(diver: EvaluationResult, tmp_path: Path) -> None:
    diver.save(tmp_path)
    loaded = load_result(tmp_path)
    assert loaded.to_dict() == diver.to_dict()
    for seed in diver.seeds:
        np.testing.assert_array_equal(loaded.flights[seed].ee_path, diver.flights[seed].ee_path)


def test_equal_evaluations_give_equal_files_but_for_the_clock(diver: EvaluationResult) -> None:
    again = fly(range(100, 140), dive=True, command="aerial-il evaluate policy=diver")
    one, two = (json.loads(json.dumps(r.to_dict())) for r in (diver, again))
    assert one["provenance"].pop("wall_time_s") > 0
    assert two["provenance"].pop("wall_time_s") > 0
    assert one == two


@settings(deadline=None)
@given(st.integers(1, 400), st.integers(0, 99))
def test_a_simplified_path_stays_close_however_long_it_is(length: int, seed: int) -> None:
    path = np.random.default_rng(seed).normal(size=(length, 3)).cumsum(axis=0) * 0.01
    kept = simplified(path, 0.005)
    assert (kept[0] == path[0]).all()
    assert (kept[-1] == path[-1]).all()
    corners = [int(np.flatnonzero((path == point).all(axis=1))[0]) for point in kept]
    assert corners == sorted(corners)
    for first, last in pairwise(corners):
        stretch = path[last] - path[first]
        share = np.clip((path[first : last + 1] - path[first]) @ stretch / (stretch @ stretch), 0, 1)
        away = path[first : last + 1] - path[first] - share[:, None] * stretch
        assert np.linalg.norm(away, axis=1).max() <= 0.005 + 1e-12


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda raw: raw | {"schema": "other/9"}, "has schema 'other/9'; this version reads"),
        (lambda raw: [raw], "has schema None"),
        (lambda raw: {k: v for k, v in raw.items() if k != "tier"}, "not an evaluation: 'tier'"),
        (lambda raw: raw | {"per_episode": raw["per_episode"][:-1]}, "states 40 episodes .* lists 39"),
        (lambda raw: raw | {"per_episode": [{"seed": 1}]}, "not an evaluation"),
        (
            lambda raw: raw | {"per_episode": raw["per_episode"][:1] * 40},
            "more than once; a seed is one flight",
        ),
        *(
            (lambda raw, wrong=wrong: raw | {"per_episode": [raw["per_episode"][0] | wrong]}, "not an evaluation: ")
            for wrong in (
                {"seed": "abc"},
                {"end": "win"},
                {"subtasks": None},
                {"return": None},
                {"steps": "9"},
                {"duration_s": "x"},
                {"contact_events": None},
                {"subtasks": {"up": "soon"}},
                {"action_jerk_rms": []},
            )
        ),
        *(
            (lambda raw, wrong=wrong: raw | wrong, "not an evaluation: robot, task, tier")
            for wrong in ({"provenance": None}, {"provenance": []}, {"provenance": {"environment": None}}, {"tier": 3})
        ),
        (
            lambda raw: raw | {"per_episode": [*raw["per_episode"][:-1], raw["per_episode"][-1] | {"subtasks": {}}]},
            "have other sub-tasks than each other",
        ),
    ],
)
def test_a_damaged_file_names_itself(diver: EvaluationResult, tmp_path: Path, damage: Any, message: str) -> None:
    path = diver.save(tmp_path)
    path.write_text(json.dumps(damage(json.loads(path.read_text()))))
    with pytest.raises(InvalidValueError, match=message) as caught:
        load_result(path)
    assert str(path) in str(caught.value)


def test_a_missing_or_broken_file_names_itself(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match=r"evaluation\.json: cannot be read .*aerial-il evaluate"):
        load_result(tmp_path)
    (tmp_path / "evaluation.json").write_text('{"schema": ')
    with pytest.raises(InvalidValueError, match="not valid JSON"):
        load_result(tmp_path)


def test_comparison_pairs_equal_seeds(diver: EvaluationResult, expert: EvaluationResult) -> None:
    comparison = compare(diver, expert)
    assert comparison.paired
    assert comparison.only_a == ()
    assert comparison.difference == pytest.approx(len(comparison.only_b) / 40)
    assert comparison.p_value == pytest.approx(2 * 0.5 ** len(comparison.only_b))
    assert comparison.ci95.lo < comparison.difference < comparison.ci95.hi
    assert "paired by seed" in comparison.summary()
    json.dumps(comparison.to_dict(), allow_nan=False)


def test_comparison_of_other_seeds_is_unpaired(diver: EvaluationResult) -> None:
    comparison = compare(diver, fly(range(20)))
    assert not comparison.paired
    assert comparison.method == "Fisher's exact test"
    assert comparison.difference > 0.2
    assert comparison.p_value < 0.05


def test_comparison_with_itself_finds_nothing(expert: EvaluationResult) -> None:
    comparison = compare(expert, expert)
    assert (comparison.difference, comparison.p_value) == (0, 1)
    assert all(change.p_value == 1 for change in comparison.changes)


def test_the_least_p_is_a_bound_that_grows_with_the_tests() -> None:
    assert p_value_text(statistics.smallest_p()) == "p <= 0.0002"
    assert p_value_text(0.0312) == "p = 0.0312"
    assert p_value_text(11 * statistics.smallest_p(), tests=11) == "p <= 0.0022"


def test_a_comparison_adjusts_for_the_numbers_it_tests(diver: EvaluationResult, expert: EvaluationResult) -> None:
    comparison = compare(diver, expert)
    changes, told = comparison.changes, comparison.summary()
    assert [c.p_adjusted for c in changes] == statistics.holm([c.p_value for c in changes])
    assert all(c.p_value <= c.p_adjusted <= 1 for c in changes)
    assert all(c.ci95.lo <= c.difference <= c.ci95.hi for c in changes)
    assert f"{len(changes)} numbers were tested at once" in told
    assert told.count(", adjusted p") == len(changes)


def test_comparison_refuses_another_task(expert: EvaluationResult) -> None:
    other = EvaluationResult("crane", "hover", "calm", "expert", expert.episodes, {})
    with pytest.raises(InvalidValueError, match="crane/reach with crane/hover"):
        compare(expert, other)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Four runs in two sweeps, and what stands about in such folders."""
    for seed, rates in enumerate(((0.1, 0.9), (0.2, 0.7))):
        make_run(tmp_path / "a" / f"seed={seed}", seed=seed, rates=rates)
        make_run(tmp_path / "b" / f"seed={seed}", seed=seed, rates=(0.5, 0.3 + 0.1 * seed))
    (tmp_path / "a" / "half").mkdir()
    (tmp_path / "a" / "half" / "config.yaml").write_text("algorithm: bc\n")
    make_run(tmp_path / "a" / "cut", rates=())
    (tmp_path / "a" / "cut" / "metrics.jsonl").write_text('{"step": 1}\n{"st\n{"step": 3}\n')
    (tmp_path / "holiday").mkdir()
    (tmp_path / "holiday" / "photo.jpg").write_bytes(b"x")
    (tmp_path / "notes.txt").write_text("x")
    return tmp_path


def names(result: RunCollection) -> list[str]:
    return [result.name(run) for run in result.runs]


def test_runs_are_found_at_any_depth_and_all_else_is_named(folder: Path) -> None:
    result = read_runs(folder)
    assert names(result) == ["a/seed=0", "a/seed=1", "b/seed=0", "b/seed=1"]
    assert {str(place.relative_to(folder)): why[:12] for place, why in result.refused.items()} == {
        "a/cut": f"{folder}/a/cut/metrics.jsonl"[:12],
        "a/half": "half-written",
        "holiday": "holds no tra",
    }
    assert result.axes == {"seed": [0, 1]}
    row = result.rows[0]
    assert (row["run"], row["state"], row["seed"], row["success"]) == ("a/seed=0", "finished", 0, 0.9)
    assert all(set(other) == set(row) for other in result.rows)


def test_a_run_alone_and_an_empty_folder_are_collections_too(folder: Path, tmp_path: Path) -> None:
    assert names(read_runs(folder / "a" / "seed=0")) == ["."]
    empty = read_runs(folder / "holiday")
    assert (empty.rows, empty.refused, empty.where(["success>0.5"]).runs) == ([], {}, ())
    with pytest.raises(InvalidValueError, match="aerial-il train"):
        read_runs(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("conditions", "left"),
    [
        (["success>0.5"], ["a/seed=0", "a/seed=1"]),
        (["success<=0.3"], ["b/seed=0"]),
        (["seed=1", "run~a/*"], ["a/seed=1"]),
        (["seed!=1", "success>=0.9"], ["a/seed=0"]),
        (["state=finished", "success<0.35"], ["b/seed=0"]),
        (["state>3"], []),
        (["policy.name=nobody"], []),
    ],
)
def test_conditions_leave_what_fulfils_all_of_them(folder: Path, conditions: list[str], left: list[str]) -> None:
    assert names(read_runs(folder).where(conditions)) == left


def test_what_is_no_condition_is_answered(folder: Path) -> None:
    result = read_runs(folder)
    with pytest.raises(InvalidValueError, match="not a condition"):
        result.where(["success"])
    with pytest.raises(UnknownNameError, match="Did you mean 'success'"):
        result.where(["sucess>0.5"])
    with pytest.raises(UnknownNameError, match="Did you mean 'success'"):
        result.sorted_by("-sucess")


def test_runs_are_sorted_by_numbers_upwards_and_downwards(folder: Path) -> None:
    result = read_runs(folder)
    assert names(result.sorted_by("success")) == ["b/seed=0", "b/seed=1", "a/seed=1", "a/seed=0"]
    assert names(result.sorted_by("-success")) == ["a/seed=0", "a/seed=1", "b/seed=1", "b/seed=0"]
    make_run(folder / "c", rates=())
    assert names(read_runs(folder).sorted_by("-success"))[-1] == "c", "what was never flown stands last"


def test_links_are_not_followed(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    make_run(elsewhere / "run")
    (folder / "link").symlink_to(elsewhere)
    assert "link/run" not in names(read_runs(folder))
