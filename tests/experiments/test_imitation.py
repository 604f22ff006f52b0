"""Studies of imitation, of its experts, of pixels and of hands: what is flown, and what their tables say."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aerial_il.algorithms.bc import BC
from aerial_il.core.errors import InvalidValueError
from aerial_il.data.waypoints import LOOKAHEAD_S, Waypoints
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.policies.mlp import MLP
from aerial_il.policies.parts.layout import TO_BE_SEEN
from experiments.common.demonstrations import Source
from experiments.common.stages import Cloned
from experiments.experts import study as experts
from experiments.experts.study import distinct
from experiments.human_data.study import TEACHERS, ClonedDriver, HumanData
from experiments.imitation import study as imitation
from experiments.imitation.study import Flight, Imitation
from experiments.instructions import study as instructions
from experiments.pixels import study as pixels
from experiments.pixels.changes import CONTROLS, changed
from tests.experiments.results import result_with

ROBOTS = ("fa_hexa_arm4", "ua_quad_arm4", "big_four_z1")
SMALL: dict[str, Any] = {
    "policies": {"mlp": MLP(hidden=(16,))},
    "algorithms": {"mlp": BC(steps=10, batch_size=16)},
    "robots": ("fa_hexa_arm4",),
    "tasks": ("reach",),
    "demos": 2,
    "flown_in": ("calm",),
    "draws": (0, 1),
    "episodes": 2,
    "num_envs": 2,
    "threads": 1,
}


def test_every_manipulation_task_is_flown_in_three_draws() -> None:
    study = Imitation()
    flights = [flight.arm | {"draw": flight.training.source.draw} for flight in study.planned_flights()]
    assert {f["robot"] for f in flights} == set(ROBOTS)
    cells = {(f["robot"], f["task"]) for f in flights}
    assert cells == {c for c in imitation.aerial_il.list_cells() if c[0] in ROBOTS and c[1] != "hover"}
    assert {f["draw"] for f in flights} == {0, 1, 2}
    assert len(flights) == len(cells) * 3 * len(study.flown_in)


def flown(*rates: tuple[str, int, int]) -> dict[Flight, EvaluationResult]:
    """Return evaluations of 20 episodes by (task, draw, successes)."""

    def flight(task: str, draw: int) -> Flight:
        source = Source(robot="fa_hexa_arm4", task=task, draw=draw)
        return Flight(Cloned("mlp", source, 80, MLP(), BC()), "calm")

    return {flight(task, draw): result_with(20, count) for task, draw, count in rates}


def test_the_mean_counts_tasks_alike() -> None:
    results = flown(("reach", 0, 20), ("reach", 1, 10), ("track", 0, 6), ("track", 1, 4))
    (row,) = imitation.macro_rows(results)
    assert (row["tasks"], row["draws"], row["trainings"], row["percent"]) == (2, 2, 4, 50.0)
    assert row["worst"] == "track (25 %)"
    assert row["trainings_low"] < row["flights_low"] < 50 < row["flights_high"] < row["trainings_high"]


def test_methods_are_told_apart_by_draws_that_all_of_them_flew() -> None:
    results = {
        replace(flight, training=replace(flight.training, method=method)): result_with(20, count)
        for method, counts in {"mlp": (2, 4, 3), "flow": (18, 20, 19), "act": (20,), "gmm": (10, 9, 11)}.items()
        for flight, count in zip(flown(*(("reach", draw, 0) for draw in range(3))), counts, strict=False)
    }
    (row,) = imitation.told_apart(results)
    assert (row["best"], row["worst"], row["points"], row["draws"]) == ("flow", "mlp", 80.0, 3)
    assert row["low"] == row["high"] == 80.0, "each draw says the same"
    alone = {flight: result for flight, result in results.items() if flight.training.method == "mlp"}
    assert not [*imitation.told_apart(alone)]


def test_a_task_tells_methods_apart_by_three_draws_that_agree() -> None:
    clear = {"task": "reach", "points": 20.0, "low": 5.0, "high": 35.0, "draws": 3}
    gusty = {**clear, "flown_in": "gusts"}
    chance = [
        {**clear, "task": "a", "draws": 2},
        {**clear, "task": "b", "low": -4.0},
        {**clear, "task": "c", "points": 14.9},
    ]
    (target,) = imitation.targets_apart([*chance, clear, gusty])
    assert (target.measured, target.spread, target.met) == (1, "reach", False), "a task counts once"
    assert not [*imitation.targets_apart(chance[:1])]


def test_a_task_that_lacks_a_draw_is_not_averaged_over() -> None:
    with pytest.raises(InvalidValueError, match="as many trainings of each"):
        imitation.macro_rows(flown(("reach", 0, 20), ("reach", 1, 10), ("track", 0, 6)))


def test_targets_are_judged_in_full_only_and_can_be_missed() -> None:
    study = Imitation()
    row = {"robot": "fa_hexa_arm4", "method": "mlp", "trained_in": "calm", "flown_in": "calm", "percent": 94.0}
    row |= {f"{unit}_{end}": 90.0 for unit in ("flights", "trainings") for end in ("low", "high")}
    tasks = len(imitation.able_tasks("fa_hexa_arm4"))
    macro, peg = [{**row, "tasks": tasks}], [{**row, "task": "insert_peg"}]
    assert [(t.limit, t.met) for t in study.targets_of(macro, peg)] == [(95.0, False), (90.0, True)]
    assert not list(study.targets_of([{**row, "tasks": tasks - 1}], [{**row, "task": "reach"}]))
    assert not list(replace(study, draws=(0,)).targets_of(macro, peg)), "one draw proves nothing"
    assert not list(study.targets_of([{**macro[0], "method": "act"}], [])), "nor does another class than the default"


@pytest.mark.slow
def test_an_arm_that_is_added_flies_itself_only(tmp_path: Path) -> None:
    report = Imitation(**SMALL).run(tmp_path, progress=False)
    (row,) = report.tables["Each task"]
    assert (row["trainings"], row["episodes"]) == (2, 4)
    assert set(report.figures) == {"tasks.svg"}
    shown = sorted(path.name.rsplit("-", 2)[1] for path in tmp_path.rglob("*.mcap"))
    assert shown == ["000000", "000001", "100000", "100001"], "other demonstrations in each draw"

    kept = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.name == "evaluation.json"}
    again = Imitation(**SMALL).run(tmp_path, progress=False)
    assert json.dumps(again.tables) == json.dumps(report.tables)
    assert again.wall_time_s == report.wall_time_s

    wider = {**SMALL["policies"], "wide": MLP(hidden=(8,))}
    more = {**SMALL, "methods": (), "policies": wider, "algorithms": dict.fromkeys(wider, SMALL["algorithms"]["mlp"])}
    added = Imitation(**more).run(tmp_path, progress=False)
    assert added.tables["Each task"][0] == row
    assert len(added.tables["Each task"]) == 2
    found = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.name == "evaluation.json"}
    assert len(found) == 2 * len(kept)
    assert kept.items() <= found.items()

    Imitation(**{**SMALL, "algorithms": {"mlp": BC(steps=11, batch_size=16)}}).run(tmp_path, progress=False)
    assert len(list(tmp_path.rglob("evaluation.json"))) == 3 * len(kept), "other steps are another training"


def test_tiers_in_which_the_flights_are_the_same_count_once() -> None:
    calm, hard = result_with(4, 4), result_with(4, 2)
    assert distinct({"calm": calm, "breeze": calm, "hard": hard}) == {"calm": ["breeze"], "hard": []}


def test_every_target_can_be_missed() -> None:
    cells = [("big_four_z1", "inspect_contact"), ("ua_quad_arm4", "insert_peg"), ("ua_quad_arm4", "reach")]
    none = {"percent": 0.0, "ci95_low": 0.0, "ci95_high": 2.0, "success": 0, "episodes": 200}
    rows = [{"robot": r, "task": t, "tier": tier, **none} for r, t in cells for tier in ("calm", "gusts", "hard")]
    targets = list(experts.targets_of(rows))
    assert [t.limit for t in targets] == [99.0, 95.0, 85.0, 99.0, 95.0, 95.0, 99.0, 95.0]
    assert not any(target.met for target in targets)


def test_flying_by_camera_is_judged_beside_its_controls() -> None:
    study = pixels.Pixels(draws=(0,), tasks=("reach", "pick_place"))
    flown = [(f.arm["sees"], f.tier) for f in study.planned() if f.arm["task"] == "reach"]
    assert flown[:4] == [
        ("perception", "calm"),
        ("perception", "gusts"),
        ("perception, images blanked", "calm"),
        ("perception, first frame for ever", "calm"),
    ]
    hidden = {f.training.method: f.training.policy.masked_fields for f in study.planned()}
    assert TO_BE_SEEN in hidden["end to end"]
    (untold, told, asked) = (
        study._training(arm, "reach", 0, 80)
        for arm in ("end to end", "end to end, auxiliary loss", "end to end, dagger")
    )
    assert told.policy == untold.policy == asked.policy
    assert untold.algorithm == study.cloning == asked.algorithm.training
    assert told.algorithm == replace(study.cloning, auxiliary=1.0)
    spread = {"flights_low": 0.0, "flights_high": 100.0, "train_min": 70.0, "tier": "calm"}
    macro = [{"sees": "perception, images blanked", "percent": 25.0, **spread}]
    rows = [{"sees": "perception", "task": "pick_place", "percent": 96.0, **spread}]
    starts = [
        {"sees": "perception", "task": "reach", "starts": where, "percent": percent, **spread}
        for where, percent in (("in view", 79.0), ("out of view", 90.0))
    ]
    verdicts = {target.what: target.met for target in study.targets_of(macro, rows, starts)}
    assert verdicts == {
        "reach, perception: success of flights that begin with the target in view": False,
        "perception, images blanked: mean success": False,
        "pick_place, perception: success": True,
        "pick_place, perception: training": False,
    }


def test_some_tasks_are_trained_more_often_and_the_mean_counts_all_alike() -> None:
    study = pixels.Pixels(arms=("perception",), flown_in=("calm",))
    planned = [flight for flight in study.planned() if not flight.changed]
    assert {f.training.source.draw for f in study.planned() if f.changed} == {0}
    draws = {task: [f.training.source.draw for f in planned if f.training.source.task == task] for task in study.tasks}
    assert draws == {task: [0, 1, 2] if task in study.repeated else [0] for task in study.tasks}
    counts = {"insert_peg": (10, 0, 0), "reach": (20,)}
    results = {
        f: result_with(20, counts[task][f.training.source.draw]) for f in planned if (task := f.arm["task"]) in counts
    }
    (row,) = pixels.macro_rows(results)
    assert (row["tasks"], row["draws"], row["percent"]) == (2, 1, 75.0)


def test_misled_policies_see_what_they_are_shown() -> None:
    class Looks:
        def act(self, obs: Mapping[str, np.ndarray]) -> np.ndarray:
            return obs["wrist_rgb"].reshape(2, -1)[:, :1] * 1.0

        def reset(self, mask: np.ndarray | None = None) -> None: ...

    frames = [np.full((2, 4, 4, 3), value, np.uint8) for value in (10, 20, 30)]
    black, frozen = (changed(Looks(), each, ("wrist_rgb",)) for each in CONTROLS)
    assert all(black.act({"wrist_rgb": frame}).max() == 0.0 for frame in frames)
    assert [frozen.act({"wrist_rgb": frame}).tolist() for frame in frames] == [[[10.0], [10.0]]] * 3
    frozen.reset(np.array([False, True]))
    assert frozen.act({"wrist_rgb": frames[2]}).tolist() == [[10.0], [30.0]]
    frozen.reset()
    assert frozen.act({"wrist_rgb": frames[1]}).tolist() == [[20.0], [20.0]]


SUITED = Waypoints(lookahead_s=LOOKAHEAD_S, flown_by="hand")


def test_only_the_drivers_arm_is_suited_to_hands() -> None:
    found = {teacher: training for _, teacher, training in HumanData(arms=("flow",), draws=(0,)).all_trainings()}
    driver, recorded, script = (found[teacher] for teacher in TEACHERS)
    assert isinstance(driver, ClonedDriver)
    assert isinstance(recorded, ClonedDriver)
    assert isinstance(script, Cloned)
    assert (driver.algorithm.waypoints, driver.policy.relative) == (SUITED, True)
    for other in (recorded, script):
        assert (other.algorithm.waypoints, other.policy.relative) == (BC.waypoints, False)
    assert driver.driven == recorded.driven
    assert {training.policy.name for training in found.values()} == {"flow"}


def test_a_cube_that_fell_is_not_the_wrong_task_done() -> None:
    """The episode ends as dropped for either cube; only one whose own cube was never grasped did the other's task."""
    (flight,) = result_with(1, 0).episodes
    ended = [
        replace(flight, end=end, subtasks={"grasped": grasped})
        for end, grasped in (("dropped", None), ("dropped", 2.0), ("timeout", None), ("success", 2.0))
    ]
    found = [replace(result_with(1, 0), episodes=tuple(ended))]
    assert instructions.wrongly_done({"task": "place_orange"}, found) == {"wrong_done_percent": 25.0}
    assert instructions.wrongly_done({"task": "reach"}, found) == {"wrong_done_percent": None}
