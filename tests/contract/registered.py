"""All registered combinations, and short ways to load them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import aerial_il
from aerial_il.control.actions import ActionLevel
from aerial_il.core.specs import ActionSpec
from aerial_il.suite import tiers
from aerial_il.suite.batch import BatchEnvironment
from aerial_il.suite.environment import AerialEnvironment

CELLS = aerial_il.list_cells()
TIERS = tiers.names()
LEVELS = tuple(level.label for level in ActionLevel)

each_cell = pytest.mark.parametrize(("robot", "task"), CELLS)
each_tier = pytest.mark.parametrize("tier", TIERS)
each_level = pytest.mark.parametrize("level", LEVELS)


@cache
def single(robot: str, task: str, tier: str = "calm", level: str = "ee_pose") -> AerialEnvironment:
    """One world, shared by all tests: reset it first."""
    return aerial_il.load(robot, task, tier=tier, action=level)


@cache
def batch(robot: str, task: str, tier: str = "calm", level: str = "ee_pose", num_envs: int = 3) -> BatchEnvironment:
    """Several worlds, shared by all tests: reset them first."""
    return aerial_il.load_batch(robot, task, num_envs=num_envs, tier=tier, action=level)


def random_actions(spec: ActionSpec, steps: int, num_envs: int, seed: int = 0) -> np.ndarray:
    """Uniform actions (steps, n, Da), and every fourth one beyond its bounds."""
    rng = np.random.default_rng(seed)
    actions = rng.uniform(spec.low, spec.high, (steps, num_envs, spec.size))
    actions[::4] *= 1.5
    return actions
