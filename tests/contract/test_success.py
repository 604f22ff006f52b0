"""Success is what the instruction says, judged a second time from raw positions.

Each task's worlds are put into random states: where the object belongs, and where it does not. A predicate written
here, from the instruction, must agree with the task's own assessment in every one: of 1,000, of 10,000 (slow).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pytest

from aerial_il.suite import tasks
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.episode import measured
from tests.contract.placed import (
    ALL,
    ANY,
    NONE,
    SOME,
    WORLDS,
    Predicate,
    Scatter,
    Stage,
)
from tests.contract.rules_of_assembly import FRAME, beam_in_hooks
from tests.contract.rules_of_dynamics import LOAD, TOSS, ball_in_bin, load_delivered
from tests.contract.rules_of_force import BULB, WINDOW, bulb_screwed_in, window_clean
from tests.contract.rules_of_harvest import FRUIT, fruit_in_basket
from tests.contract.rules_of_long_tasks import (
    RESTOCKED,
    SET_DOWN,
    SORTED,
    cube_set_down,
    cubes_shut_in,
    pegs_sorted,
)
from tests.contract.rules_of_objects import (
    BUTTON,
    CUBE,
    PEG,
    button_pressed,
    cube_in_bowl,
    door_open,
    joint_families,
    lever_at_pin,
    one_cube_in_bowl,
    one_of_two,
    peg_in_socket,
    slider_at_end,
    spoke_over_mark,
)
from tests.contract.rules_of_perch import PERCHED, flown_off
from tests.contract.rules_of_poses import (
    HOVER,
    LAND,
    LAP,
    PROBE,
    REACH,
    TAKE_OFF,
    base_at_mark,
    lap_followed,
    on_the_pad,
    probe_on_spot,
    tool_at_mark,
)

PLACEMENTS, AT_LENGTH = 1_000, 10_000


def judged(env: BatchEnvironment) -> np.ndarray:
    """(n,) what the task says of the present states."""
    return measured.truth(env.simulation.task.kernels.solved)(env.simulation.view)


@pytest.mark.parametrize("task", tasks.names())
def test_success_is_what_the_instruction_says(task: str) -> None:
    check(task, judged)


@pytest.mark.slow
@pytest.mark.parametrize("task", tasks.names())
def test_success_is_what_the_instruction_says_at_length(task: str) -> None:
    check(task, judged, AT_LENGTH)


def test_a_judge_who_overlooks_the_floor_is_noticed() -> None:
    def lenient(env: BatchEnvironment) -> np.ndarray:
        cube = env.simulation.view.site_pos("cube")
        beside = np.hypot(*(cube - env.simulation.view.site_pos("bowl"))[:, :2].T)
        return judged(env) | ((beside <= 0.05) & (cube[:, 2] < 0.3))

    with pytest.raises(AssertionError, match="under the bowl"):
        check("pick_place", lenient)


def test_a_task_without_a_rule_is_refused_with_what_to_write() -> None:
    with pytest.raises(AssertionError, match="juggle has no rule here"):
        check("juggle", judged)


def check(task: str, judge: Callable[[BatchEnvironment], np.ndarray], placements: int = PLACEMENTS) -> None:
    """Compare a judge with the task's rule on all placements.

    Raises:
        AssertionError: there is no rule, they differ, or the placements try nothing.
    """
    assert task in RULES, (
        f"{task} has no rule here. Add one to RULES: a predicate over raw positions that says what its instruction "
        "asks for, and families of placements that fulfil it, that miss it, and that lie on either side of each limit."
    )
    rule, stage, rng = RULES[task], Stage(task), np.random.default_rng(1)
    count: dict[str, list[np.ndarray]] = {name: [] for name in rule.families}
    for round_ in range(placements // WORLDS):
        placed = stage.scatter(rule.families, 1000 * round_, rng)
        expected, result = rule.predicate(placed), judge(stage.env)
        for k, name in enumerate(rule.families):
            rows = stage.family == k
            wrong = rows & (expected != result)
            assert not wrong.any(), f"{name}: the task says {result[wrong][0]}, the instruction {expected[wrong][0]}"
            count[name].append(expected[rows])
    for name, (outcome, _) in rule.families.items():
        share = np.concatenate(count[name]).mean()
        right = {ALL: share == 1.0, NONE: share == 0.0, SOME: 0.05 < share < 0.95, ANY: True}
        assert right[outcome], f"{name}: {100 * share:.1f} % count, expected: {outcome}"


@dataclass(frozen=True)
class Rule:
    """What a task's instruction asks for, and placements to try it on: name -> (expected outcome, how to place)."""

    predicate: Predicate
    families: Mapping[str, tuple[str, Scatter]]


RULES = {
    "assemble_frame": Rule(beam_in_hooks, FRAME),
    "carry_slung_load": Rule(load_delivered, LOAD),
    "cabinet_retrieve": Rule(cube_set_down, SET_DOWN),
    "harvest_fruit": Rule(fruit_in_basket, FRUIT),
    "hover": Rule(base_at_mark, HOVER),
    "insert_peg": Rule(peg_in_socket, PEG),
    "inspect_contact": Rule(probe_on_spot, PROBE),
    "land": Rule(on_the_pad, LAND),
    "open_door": Rule(door_open, joint_families("door", np.deg2rad(60.0), 1.85, "door", 0.02)),
    "perch": Rule(flown_off, PERCHED),
    "pick_moving": Rule(cube_in_bowl, CUBE),
    "pick_place": Rule(cube_in_bowl, CUBE),
    "place_green": Rule(one_cube_in_bowl("green_cube", "orange_cube"), one_of_two("green_cube", "orange_cube")),
    "place_orange": Rule(one_cube_in_bowl("orange_cube", "green_cube"), one_of_two("orange_cube", "green_cube")),
    "press_button": Rule(button_pressed, BUTTON),
    "pull_lever": Rule(lever_at_pin, joint_families("lever", np.deg2rad(55.0), 1.5, "lever", 0.02)),
    "push_slider": Rule(slider_at_end, joint_families("slider", 0.225, 0.26, "slider", 0.002)),
    "reach": Rule(tool_at_mark, REACH),
    "restock": Rule(cubes_shut_in, RESTOCKED),
    "rotate_valve": Rule(spoke_over_mark, joint_families("valve", 1.25 * np.pi, 1.25 * np.pi + 0.6, "valve", 0.02)),
    "sort_pegs": Rule(pegs_sorted, SORTED),
    "screw_bulb": Rule(bulb_screwed_in, BULB),
    "take_off": Rule(base_at_mark, TAKE_OFF),
    "toss_ball": Rule(ball_in_bin, TOSS),
    "track": Rule(lap_followed, LAP),
    "wipe_window": Rule(window_clean, WINDOW),
}
