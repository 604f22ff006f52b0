"""One evaluation with all three ends, flown once and shared."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import aerial_il
from aerial_il.core.rendering import can_render
from aerial_il.data.episode import Episode
from aerial_il.evaluation.outcome import subtask_flags
from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.rollouts import evaluate
from aerial_il.workflows.parts.pilots import record
from tests.evaluation.hover import GoThere, HoverBatch


@pytest.fixture(autouse=True)
def skip_without_rendering(request: pytest.FixtureRequest) -> None:
    if request.node.get_closest_marker("render") and not can_render():
        pytest.skip("no rendering back end on this machine")


@pytest.fixture(scope="session")
def diver() -> EvaluationResult:
    """40 seeds of a policy that succeeds, crashes and runs out of time."""
    origin = {"command": "aerial-il evaluate policy=diver"}
    policy = GoThere(dive=True)
    return evaluate(HoverBatch(16), policy, range(100, 140), policy_name="diver", origin=origin, progress=False)


@pytest.fixture(scope="session")
def expert() -> EvaluationResult:
    """The same seeds, flown without diving."""
    return evaluate(HoverBatch(16), GoThere(), range(100, 140), policy_name="expert", progress=False)


@dataclass(frozen=True)
class Flown:
    """A flight of an expert in the suite, its recording and its sub-tasks (T, K)."""

    file: Path
    episode: Episode
    flags: np.ndarray


@pytest.fixture(scope="session")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Flown:
    env = aerial_il.load_batch("ua_quad_arm4", "reach", num_envs=1, num_threads=1)
    file = tmp_path_factory.mktemp("flown") / "reach.mcap"
    episode = record(env, aerial_il.expert("ua_quad_arm4", "reach"), 1, file, name="expert")
    flags = subtask_flags(env, episode)
    env.close()
    return Flown(file, episode, flags)
