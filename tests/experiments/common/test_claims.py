"""Headline claims: each finds its figure, and a false one is told from a true one."""

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from aerial_il.core import registry
from aerial_il.core.composition import build
from aerial_il.core.errors import InvalidValueError
from experiments.common.claims import BROKEN, HOLDS, UNCHECKED, checked, checks_of, judged
from experiments.common.page import NUMBERS

CHECK = {"table": "Success", "named_by": ["task"], "number": "percent", "intervals": ["flights", "trainings"]}
TINY = {"robots": ["fa_hexa_arm4"], "tiers": ["calm"], "seeds": 1, "settle_s": 0.1, "duration_s": 0.1}
CLAIMED = [name for name in registry.names("study") if checks_of(name)]


def row(percent: float, low: float, high: float, **more: Any) -> dict[str, Any]:
    ends = {"flights_low": low, "flights_high": high, "trainings_low": None, "trainings_high": None}
    return {"task": "reach", "percent": percent, **ends, **more}


def told(root: Path, recorded: list[dict[str, Any]], check: dict[str, Any], name: str = "made_up") -> Path:
    """Write a study's results and claims."""
    (root / name).mkdir(parents=True)
    results = {"tables": {check["table"]: recorded}, "command": f"aerial-il bench {name} save=true"}
    (root / name / NUMBERS).write_text(json.dumps(results))
    (root / name / "claims.yaml").write_text(yaml.safe_dump([check]))
    return root


@pytest.mark.parametrize(
    ("recorded", "now", "verdict"),
    [
        (row(98, 95, 99), row(90, 80, 96), HOLDS),
        (row(98, 95, 99), row(90, 80, 94), BROKEN),
        (row(98, 95, 99, trainings_low=92, trainings_high=100), row(90, 80, 94), HOLDS),
        (row(20, 15, 25), row(90, 80, 94), BROKEN),
        (row(98, 95, 99), row(98, 95, 99, task="track"), BROKEN),
    ],
)
def test_it_holds_where_intervals_overlap(
    recorded: dict[str, Any], now: dict[str, Any], verdict: str, tmp_path: Path
) -> None:
    root = told(tmp_path, [recorded], {**CHECK, "settings": {}})
    (check,) = checks_of("made_up", root)
    (result,) = judged("made_up", check, {"tables": {"Success": [now]}}, root)
    assert result["verdict"] == verdict


def test_an_error_of_the_small_version_does_not_pass_for_holding(tmp_path: Path) -> None:
    root = told(tmp_path, [row(98, 95, 99)], {**CHECK, "settings": {}})
    (result,) = judged("made_up", checks_of("made_up", root)[0], {"error": "OSError: full"}, root)
    assert (result["verdict"], result["note"]) == (BROKEN, "OSError: full")


def test_what_is_not_checked_names_the_whole_command(tmp_path: Path) -> None:
    root = told(tmp_path, [row(98, 95, 99)], CHECK)
    (result,) = checked(["made_up"], tmp_path / "out", root=root, abreast=0)
    assert (result["verdict"], result["note"]) == (UNCHECKED, "aerial-il bench made_up save=true")


def test_rows_of_one_name_are_pooled_by_their_counts(tmp_path: Path) -> None:
    check = build(type(checks_of("experts")[0]), CHECK)
    value, low, high = check.interval([{"success": 90, "episodes": 100}, {"success": 100, "episodes": 100}])
    assert value == 95.0
    assert 90.0 < low < 95.0 < high < 98.0


@pytest.mark.parametrize(("error_cm", "verdict"), [(None, HOLDS), (-5.0, BROKEN)])
def test_a_false_figure_of_a_real_study_is_found_out(error_cm: float | None, verdict: str, tmp_path: Path) -> None:
    check = {
        "table": "Tracking", "where": {"reference": "hover", "controller": "pid"}, "named_by": ["robot"],
        "number": "rmse_cm", "intervals": [], "settings": TINY,
    }  # fmt: skip
    measured = registry.get("study", "tracking")(**{k: tuple(v) if isinstance(v, list) else v for k, v in TINY.items()})
    rows = [dict(r) for r in measured.run(tmp_path / "once", progress=False).tables["Tracking"]]
    for each in rows:
        each["rmse_cm"] += error_cm or 0.0
    root = told(tmp_path / "root", rows, check, "tracking")
    result = checked(["tracking"], tmp_path / "out", root=root, abreast=0)
    assert [each["verdict"] for each in result] == [verdict]


@pytest.mark.parametrize("name", CLAIMED)
def test_claims_of_a_study_are_found_in_its_results(name: str) -> None:
    study = registry.get("study", name)
    for check in checks_of(name):
        assert list(judged(name, check, None))
        build(study, check.settings or {}, base=study())


def test_a_claim_without_a_figure_is_refused(tmp_path: Path) -> None:
    root = told(tmp_path, [row(98, 95, 99)], {**CHECK, "where": {"task": "fold"}})
    with pytest.raises(InvalidValueError, match="no row of 'Success'"):
        list(judged("made_up", checks_of("made_up", root)[0], None, root))
