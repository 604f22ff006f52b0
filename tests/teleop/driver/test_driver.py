"""The model of a driver: it does the task through the sticks alone, sees no more than the page is told, and late."""

import ast
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import aerial_il
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.data.dataset import open_dataset
from aerial_il.data.replay import replay
from aerial_il.teleop import driver as room
from aerial_il.teleop.devices.driver import BINDINGS, Driver
from aerial_il.teleop.driver.eyes import Eyes, Sight
from aerial_il.teleop.driver.habit import Habit
from aerial_il.teleop.driver.operator import DriverOperator
from aerial_il.teleop.driver.plan import plan_for
from aerial_il.teleop.driver.watch import Judgement, Watch
from aerial_il.teleop.session.cockpit import Cockpit
from aerial_il.teleop.session.logbook import Logbook
from aerial_il.teleop.session.refly import refly
from tests.teleop.hands import world

HIDDEN = ("env", "batch", "view", "mujoco", "suite", "experts", "simulation", "physics")


@pytest.mark.parametrize("task", ["pick_place", "reach"])
def test_it_solves_tasks_at_the_sticks_and_flights_replay(task: str, tmp_path: Path) -> None:
    env = world(task=task)
    DriverOperator(seed=1).record(env, None, tmp_path, seeds=range(5000, 5002), tags={})
    episodes = list(aerial_il.open_dataset(str(tmp_path)))
    assert [episode.success for episode in episodes] == [True, True]
    for episode in episodes:
        assert refly(env, episode) == replay(env, episode) == len(episode)
        assert episode.extras["device"].any()
        assert not episode.is_intervention.any(), "where no policy flies nobody takes over from one"


def test_what_is_finished_is_kept(tmp_path: Path) -> None:
    env = world()
    for last in (5001, 5002, 5002):
        DriverOperator().record(env, None, tmp_path, seeds=range(5000, last), tags={})
    assert sorted(e.seed for e in open_dataset(tmp_path, failures=True)) == [5000, 5001]


def test_what_nobody_can_fly_by_hand_is_refused(tmp_path: Path) -> None:
    batch = aerial_il.load_batch("ua_quad_arm4", "reach", num_envs=2)
    with pytest.raises(InvalidValueError, match="num_envs is 2; a person flies one world"):
        DriverOperator().record(batch, None, tmp_path, seeds=range(5000, 5001), tags={})
    outside = aerial_il.load_gymnasium("CartPole-v1")
    with pytest.raises(InvalidValueError, match="only its tasks are flown by hand"):
        DriverOperator().record(outside, None, tmp_path, seeds=range(5000, 5001), tags={})


def test_its_room_imports_nothing_that_knows_the_simulator() -> None:
    """A driver that read the simulator would see more than a person; only who ticks the cockpit has an environment."""
    files = [*Path(room.__file__).parent.rglob("*.py"), Path(room.__file__).parents[1] / "devices" / "driver.py"]
    seen = [file for file in files if file.name != "operator.py"]
    assert len(seen) >= 9
    for file in seen:
        tree = ast.parse(file.read_text())
        named = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        named |= {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
        assert not [name for name in named if set((name or "").split(".")) & set(HIDDEN)], file
        attributes = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
        assert not attributes & {"env", "_obs", "get_state", "physics", "_arbiter"}, file


def test_it_flies_by_a_record_of_the_page_alone(tmp_path: Path) -> None:
    """Given the same page again, without any simulator, it moves the sticks to the bit as before."""
    env = world()
    cockpit = Cockpit(env, BINDINGS, Logbook(env, str(tmp_path), operator="x", first_seed=5000), countdown=1)
    live, page, frames = Driver("reach", cockpit.readings, dt=0.02), [], []
    for _ in range(120):
        page.append(cockpit.status())
        live.see(page[-1])
        frames.append(live.frame())
        cockpit.tick(frames[-1])
    blind = Driver("reach", cockpit.readings, dt=0.02)
    for status, frame in zip(page, frames, strict=True):
        blind.see(status)
        assert blind.frame() == frame
    cockpit.close()


def test_it_reacts_a_quarter_of_a_second_late(tmp_path: Path) -> None:
    env = world()
    cockpit = Cockpit(env, BINDINGS, Logbook(env, str(tmp_path), operator="x"), countdown=1)
    eyes = Eyes(cockpit.readings, reaction_ticks=12, rng=np.random.default_rng(0))
    shown = replace(cockpit.status(), steps=0)
    assert [eyes.look(replace(shown, steps=k)).status.steps for k in range(20)] == [0] * 12 + list(range(8))
    cockpit.close()


def test_habits_differ_from_flight_to_flight() -> None:
    habits = [Habit.draw(np.random.default_rng(seed)) for seed in range(40)]
    assert {np.sign(h.side) for h in habits} == {-1.0, 1.0}
    assert {h.height > 0.15 for h in habits} == {h.speed > 0.25 for h in habits} == {False, True}
    assert {h.turns_first for h in habits} == {False, True}


def test_a_task_without_a_plan_lists_those_with_one() -> None:
    with pytest.raises(UnknownNameError, match="pick_place, reach"):
        plan_for("hover")


def test_it_takes_over_in_trouble_and_hands_back() -> None:
    by = Judgement(patience_ticks=50, step_m=0.02, astray_m=0.1, sure_ticks=25, enough_m=0.1, least_ticks=10)
    assert not any(Watch(by).judge(1.0) for _ in range(50)), "not before its patience ends"
    watch = Watch(by)
    assert not any(watch.judge(1.0 - 0.001 * k) for k in range(300)), "what gets on is left alone"
    assert not any(watch.judge(0.95) for _ in range(25)), "a moment is no proof: what is shown flickers"
    assert watch.judge(0.95), "astray"
    assert all(watch.judge(0.95 - 0.01 * k) for k in range(9)), "it flies for a while at least"
    assert not watch.judge(0.7)
    stuck = [watch.judge(0.7) for _ in range(60)]
    assert not stuck[40]
    assert stuck[-1]
    assert all(watch.judge(0.7 - 0.01 * k) for k in range(60)), "again in trouble: this time it finishes"


def test_it_never_hands_back_in_the_midst_of_a_grasp() -> None:
    watch = Watch(Judgement(patience_ticks=50, enough_m=0.1, least_ticks=10))
    assert [watch.judge(1.0) for _ in range(53)][-1]
    assert all(watch.judge(0.5, delicate=True) for _ in range(100))
    assert not watch.judge(0.5)


def beside_the_cube(ahead: float, up: float, gripper: float, leaning: float = 0.0) -> Sight:
    """What is seen with the tool beside a cube that is not held."""
    numbers: dict[str, tuple[float, ...]] = {"tool to cube": (ahead, 0.0, up), "turn to cube": (0.0,)}
    numbers |= {"cube to bowl": (0.4, 0.0, 0.0), "gripper": (gripper,), "tool points": (0.5 * np.pi + leaning, 0.0)}
    status = SimpleNamespace(subtasks={"grasped": False, "in_bowl": False})
    return Sight(status, numbers)  # type: ignore[arg-type]  # the rest is not looked at


def test_a_cube_is_given_up_after_three_tries() -> None:
    plan = plan_for("pick_place")
    plan.begin(beside_the_cube(0.0, -0.1, 1.0), Habit.draw(np.random.default_rng(0)))
    over, between = beside_the_cube(0.0, -0.1, 1.0), beside_the_cube(0.0, -0.005, 0.62)
    wishes = [plan.wish(sight) for _ in range(3) for sight in [*[over] * 2, *[between] * 75]]
    tries = 1 + [w.hopeless for w in wishes].index(True) // 77
    assert [tries, {w.part for w in wishes}, wishes[-1].hopeless] == [3, {"over", "down", "close"}, True]
