"""All registered combinations, and short ways to load them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
import pytest

import aerial_il
from aerial_il import robots
from aerial_il.control.actions import levels_of
from aerial_il.core.specs import ActionSpec
from aerial_il.experts.expert import Expert
from aerial_il.suite import tiers
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.environment import AerialEnvironment

CELLS = aerial_il.list_cells()
TIERS = tiers.names()
MAIN = ("fa_hexa_arm4", "ua_quad_arm4")
KEPT = 12  # environments at a time, some 5 MB each: what is asked of one cell is asked in a row (see conftest.py)


def covering(cells: tuple[tuple[str, str], ...]) -> tuple[tuple[str, str], ...]:
    """A few cells in which every robot and every task occurs; the main robots take the tasks in turn."""
    tasks, chosen = sorted({task for _, task in cells}), []
    for i, task in enumerate(tasks):
        able = [robot for robot, other in cells if other == task]
        main = [robot for robot in MAIN if robot in able]
        chosen.append(((main or able)[i % len(main or able)], task))
    missing = {robot for robot, _ in cells} - {robot for robot, _ in chosen}
    chosen += [next(cell for cell in cells if cell[0] == robot) for robot in sorted(missing)]
    return tuple(chosen)


SAMPLE = covering(CELLS)
OFTEN = (*SAMPLE, *(cell for cell in CELLS if cell[0] in MAIN))


def each_of(cells: Sequence[tuple[str, str]], always: Sequence[tuple[str, str]] = OFTEN) -> pytest.MarkDecorator:
    """Each of some cells; those that are not ``always`` tried are marked slow."""
    marked = [pytest.param(*cell, marks=() if cell in always else pytest.mark.slow) for cell in cells]
    return pytest.mark.parametrize(("robot", "task"), marked)


each_cell, each_sample = each_of(CELLS), each_of(CELLS, SAMPLE)


def levels(robot: str) -> tuple[str, ...]:
    """Action levels of a robot; ee_pose, the default, is the first."""
    return tuple(level.label for level in levels_of(robots.get(robot).vehicle))


def each_cell_with(name: str, values_of: Callable[[str], tuple[str, ...]]) -> pytest.MarkDecorator:
    """Every cell with every value of ``name``: in the sample the first and one of the others; the rest is marked slow.

    Args:
        name: of the argument. values_of: its values for a robot.
    """
    cases = []
    for i, cell in enumerate(CELLS):
        values = values_of(cell[0])
        for k, value in enumerate(values):
            in_turn = cell in SAMPLE and k in (0, 1 + i % (len(values) - 1))
            cases.append(pytest.param(*cell, value, marks=() if in_turn else pytest.mark.slow))
    return pytest.mark.parametrize(("robot", "task", name), cases)


each_cell_and_tier = each_cell_with("tier", lambda robot: TIERS)
each_cell_and_level = each_cell_with("level", levels)


@lru_cache(maxsize=KEPT)
def single(robot: str, task: str, tier: str = "calm", level: str = "ee_pose") -> AerialEnvironment:
    """One world, shared by the tests of a cell: reset it first."""
    return aerial_il.load(robot, task, tier=tier, action=level)


_drawn: dict[tuple[str, str], AerialEnvironment] = {}


def drawn(robot: str, task: str) -> AerialEnvironment:
    """One world to be looked at, as :func:`single`; its cameras, some 50 MB, are closed when another cell is drawn."""
    if (robot, task) not in _drawn:
        for other in _drawn.values():
            other.close()
        _drawn.clear()
        _drawn[robot, task] = aerial_il.load(robot, task)
    return _drawn[robot, task]


@lru_cache(maxsize=KEPT)
def batch(robot: str, task: str, tier: str = "calm", level: str = "ee_pose", num_envs: int = 3) -> BatchEnvironment:
    """Several worlds, shared by the tests of a cell: reset them first."""
    return aerial_il.load_batch(robot, task, num_envs=num_envs, tier=tier, action=level)


def hold_actions(worlds: BatchEnvironment) -> np.ndarray:
    """``ee_pose`` actions (n, Da) that command the present pose of the tool, gripper open if there is one."""
    obs, size = worlds.observe(), worlds.spec.action.size
    return np.concatenate([obs["ee_pos"], obs["ee_rot6d"], np.ones((len(obs["ee_pos"]), 1))], axis=1)[:, :size]


def fly_until_solved(worlds: BatchEnvironment, expert: Expert, watch: Callable[[], object] = bool) -> np.ndarray:
    """Let the expert fly to success or to the time limit, ``watch`` after each step; return who has solved it, (n,)."""
    solved = np.zeros(worlds.num_envs, bool)
    while not solved.all() and worlds.simulation.steps.max() < worlds.spec.max_steps:
        solved |= worlds.step(expert.act({}), ~solved).info["success"]
        watch()
    return solved


def random_actions(spec: ActionSpec, steps: int, num_envs: int, seed: int = 0) -> np.ndarray:
    """Uniform actions (steps, n, Da), and every fourth one beyond its bounds."""
    rng = np.random.default_rng(seed)
    actions = rng.uniform(spec.low, spec.high, (steps, num_envs, spec.size))
    actions[::4] *= 1.5
    return actions
