"""Each pair of robot and task is supported where it can be done, solved by its expert, and by nothing idle."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
import pytest

import aerial_il
from aerial_il import robots
from aerial_il.cli.commands.project.list import as_text
from aerial_il.core.errors import InvalidValueError, UnknownNameError
from aerial_il.presentation.pages import robot_pages, task_pages
from aerial_il.robots.parts.arm import Arm
from aerial_il.robots.robot import Robot
from aerial_il.suite import tasks
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.feasibility import infeasible_gentleness
from aerial_il.suite.tasks import CellError
from aerial_il.workflows.catalogue import catalogue
from tests.contract.registered import batch, each_cell, each_cell_and_tier, hold_actions, random_actions

NAME, TASK = "two_joint_hexa", "rotate_valve"
REASON = "its arm of a metre and two joints cannot follow the handwheel round"
EPISODES = 4
get_registered, registered_names = robots.get, robots.names


def two_joint_hexa(declines: Mapping[str, str]) -> Robot:
    """The hexarotor with two joints, roll and pitch, and a metre of arm behind them."""
    hexa = get_registered("fa_hexa_arm4")
    roll, shoulder, *_ = hexa.arm.links
    return replace(
        hexa,
        name=NAME,
        summary="A hexarotor with a two-joint arm.",
        arm=Arm((roll, replace(shoulder, tip=(1.0, 0.0, 0.0), limits=(-0.25, 1.9))), mount=hexa.arm.mount),
        rest_forward=(0.0, 0.0),
        rest_down=(0.0, 0.5 * np.pi),
        declines=declines,
    )


@pytest.fixture
def register(monkeypatch: pytest.MonkeyPatch) -> Iterator[type]:
    """Robots beside the registered ones, for one test."""

    class Register:
        @staticmethod
        def add(robot: Robot) -> None:
            others = lambda name: robot if name == robot.name else get_registered(name)  # noqa: E731
            monkeypatch.setattr(robots, "get", others)
            monkeypatch.setattr(robots, "names", lambda: tuple(sorted({*registered_names(), robot.name})))
            tasks.cells.cache_clear()

    yield Register
    monkeypatch.undo()
    tasks.cells.cache_clear()


def solved(robot: str, task: str, tier: str = "calm") -> int:
    """In how many of ``EPISODES`` episodes the expert solves the task."""
    env = aerial_il.load_batch(robot, task, num_envs=EPISODES, tier=tier, num_threads=1)
    expert = aerial_il.expert(robot, task)
    expert.attach(env)
    obs = env.reset(20_000)
    expert.reset()
    done, flying = np.zeros(EPISODES, bool), np.ones(EPISODES, bool)
    for _ in range(env.spec.max_steps):
        result = env.step(expert.act(obs), flying)
        obs = result.obs
        done |= result.info["success"] & flying
        flying &= ~(done | result.terminated | result.truncated)
        if not flying.any():
            break
    env.close()
    return int(done.sum())


DECLINED = [(name, task) for name in robots.names() for task in robots.get(name).declines]


@pytest.mark.parametrize(("robot", "task"), DECLINED)
def test_what_a_registered_robot_declines_it_cannot_do(register: type, robot: str, task: str) -> None:
    own = robots.get(robot)
    register.add(replace(own, declines={name: why for name, why in own.declines.items() if name != task}))
    assert solved(robot, task, "calm") < EPISODES or solved(robot, task, "hard") < EPISODES


def test_flying_shows_a_pair_that_no_rule_refuses_to_fail(register: type) -> None:
    register.add(two_joint_hexa({}))
    assert (NAME, TASK) in aerial_il.list_cells()
    assert solved(NAME, TASK) < EPISODES
    assert solved(NAME, "reach") == EPISODES


def test_a_robot_declines_a_task_in_its_file_and_says_why(register: type) -> None:
    robot = two_joint_hexa({TASK: REASON})
    register.add(robot)
    cells = aerial_il.list_cells()
    assert (NAME, TASK) not in cells
    assert (NAME, "reach") in cells
    for refused in (lambda: aerial_il.load(NAME, TASK), lambda: aerial_il.expert(NAME, TASK)):
        with pytest.raises(CellError, match=f"{NAME} cannot do {TASK}: {REASON}. Robots that can: .*fa_hexa_arm4"):
            refused()
    found = catalogue()
    assert {"robot": NAME, "task": TASK, "reason": REASON} in found["declined"]
    assert REASON in as_text(found, declined=True)
    line = f"- not `{TASK}`: {REASON}"
    assert line in robot_pages.page(robot)
    assert f"- not `{NAME}`: {REASON}" in task_pages.page(tasks.get(TASK))


def test_every_pair_is_supported_or_declined_with_a_reason() -> None:
    declined = {(row["robot"], row["task"]): row["reason"] for row in catalogue()["declined"]}
    pairs = {(robot, task) for robot in aerial_il.list_robots() for task in aerial_il.list_tasks()}
    assert declined.keys() | set(aerial_il.list_cells()) == pairs
    assert not declined.keys() & set(aerial_il.list_cells())
    assert all(len(reason.split()) >= 3 for reason in declined.values())


@pytest.mark.parametrize("reason", ["", "  ", "no", "too hard"])
def test_a_reason_that_says_nothing_is_refused(reason: str) -> None:
    with pytest.raises(InvalidValueError, match="say why"):
        two_joint_hexa({TASK: reason})


def test_an_unknown_task_cannot_be_declined(register: type) -> None:
    register.add(two_joint_hexa({"rotate_valv": REASON}))
    for ask in (aerial_il.list_cells, lambda: aerial_il.load(NAME, "reach")):
        with pytest.raises(UnknownNameError, match=f"{NAME} declines: 'rotate_valv'. Did you mean 'rotate_valve'"):
            ask()


def test_a_robot_that_declines_everything_is_refused(register: type) -> None:
    able = [task for task in tasks.names() if tasks.get(task).infeasibility(two_joint_hexa({})) is None]
    register.add(two_joint_hexa(dict.fromkeys(able, REASON)))
    with pytest.raises(InvalidValueError, match=f"{NAME} declines every task that it could do"):
        aerial_il.list_cells()
    register.add(two_joint_hexa(dict.fromkeys(able[1:], REASON)))
    assert [task for robot, task in aerial_il.list_cells() if robot == NAME] == able[:1]


def test_what_the_rules_decline_is_not_declined_twice(register: type) -> None:
    bare = replace(get_registered("quad"), name=NAME, declines={"reach": "it has no arm to reach with"})
    register.add(bare)
    with pytest.raises(InvalidValueError, match="declines reach, which its rules decline"):
        aerial_il.list_cells()


FEWEST_OF_FOUR = {"hard": 3}  # 85 % are asked of the experts there


@each_cell_and_tier
def test_the_expert_solves_it(robot: str, task: str, tier: str) -> None:
    worlds = batch(robot, task, tier, num_envs=4)
    expert = aerial_il.expert(robot, task)
    expert.attach(worlds)
    obs = worlds.reset(20_000)
    expert.reset()
    solved, touched = np.zeros(4, bool), np.zeros(4, bool)
    for _ in range(worlds.spec.max_steps):
        result = worlds.step(expert.act(obs), ~solved)
        obs = result.obs
        touched |= result.info["crash"]
        solved |= result.info["success"]
        assert (result.reward[result.info["success"]] == 1.0).all()
        if solved.all():
            break
    assert solved.sum() >= FEWEST_OF_FOUR.get(tier, 4)
    assert not touched[solved].any()


@each_cell
def test_random_actions_do_not(robot: str, task: str) -> None:
    worlds = batch(robot, task)
    worlds.reset(50)
    for actions in random_actions(worlds.spec.action, 120, 3):
        assert not worlds.step(actions).info["success"].any()


@each_cell
def test_the_reward_prefers_the_expert(robot: str, task: str) -> None:
    def mean_reward(worlds: BatchEnvironment, with_expert: bool) -> float:
        expert = aerial_il.expert(robot, task)
        expert.attach(worlds)
        obs, total = worlds.reset(60), 0.0
        expert.reset()
        start = hold_actions(worlds)
        for _ in range(100):
            result = worlds.step(expert.act(obs) if with_expert else start)
            obs, total = result.obs, total + result.reward.mean()
        return total / 100

    worlds = batch(robot, task)
    assert mean_reward(worlds, with_expert=True) > 1.5 * mean_reward(worlds, with_expert=False)


def test_a_base_is_as_stiff_as_it_is_flown() -> None:
    """Slow rotors are flown with softer gains, which keep a heavy vehicle gentle."""
    heavy = robots.get("big_four_z1")
    assert infeasible_gentleness(heavy, 15.0) is None
    assert "2.0 N/cm, too much for contact forces of at most 5 N" in (infeasible_gentleness(heavy, 5.0) or "")
