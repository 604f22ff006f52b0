"""A robot of one's own, as its page shows it: an arm from URDF, rotors from PX4; it flies, and meets the contract."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import aerial_il
from aerial_il import robots
from tests.contract import test_scene, test_solvable
from tests.contract.test_feasibility import solved
from tests.project.test_examples import FILE, found_beside_ours
from tests.robots import test_figures, test_robots

PAGE = Path(__file__).parents[3] / "docs" / "own_robot.md"


@pytest.fixture(scope="module", autouse=True)
def gull(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The files of the page where they belong."""
    top = tmp_path_factory.mktemp("checkout")
    shown = FILE.findall(PAGE.read_text(encoding="utf-8"))
    assert [path for path, _ in shown] == [f"aerial_il/robots/gull{end}" for end in ("_arm.urdf", "_rotors.px4", ".py")]
    for path, text in shown:
        (top / path).parent.mkdir(parents=True, exist_ok=True)
        (top / path).write_text(text, encoding="utf-8")
    with found_beside_ours(top):
        yield


def test_it_is_registered_and_supports_what_its_arm_allows() -> None:
    assert "gull" in aerial_il.list_robots()
    supported = {task for robot, task in aerial_il.list_cells() if robot == "gull"}
    assert {"reach", "pick_place"} <= supported
    assert supported == {task for robot, task in aerial_il.list_cells() if robot == "ua_quad_arm4"}


def test_it_is_what_a_robot_of_ours_must_be() -> None:
    robot = robots.get("gull")
    test_robots.test_actuators_come_in_the_order_rotors_joints_gripper(robot)
    test_robots.test_servos_hold_the_arm_in_any_posture(robot)
    test_robots.test_rest_postures_point_where_they_say(robot)
    test_robots.test_the_gripper_opens_closes_and_squeezes(robot)
    test_figures.test_the_centre_of_mass_is_that_of_the_simulated_robot(robot)
    test_figures.test_the_inertia_is_that_of_the_simulated_robot(robot)
    test_figures.test_hover_thrusts_balance_weight_and_the_arm(robot)


@pytest.mark.parametrize("task", ["reach", "pick_place"])
def test_its_expert_solves_the_task_and_nothing_else_does(task: str) -> None:
    test_scene.test_every_element_has_a_name("gull", task)
    test_scene.test_the_stored_scene_compiles_to_the_same_model("gull", task)
    test_solvable.test_the_expert_solves_it("gull", task, "calm")
    test_solvable.test_random_actions_do_not("gull", task)


def test_it_picks_and_places_in_gusts() -> None:
    assert solved("gull", "pick_place", "gusts") >= 3
