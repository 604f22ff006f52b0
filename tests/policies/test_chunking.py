"""History and plan of every world follow their definition, whatever is reset when."""

from __future__ import annotations

import numpy as np
import pytest

from aerial_il.core.errors import InvalidValueError
from aerial_il.policies.parts.chunking import ActionPlan, ObservationHistory

N, TA, DA, STEPS = 5, 6, 3, 40


def some_resets(rng: np.random.Generator) -> np.ndarray:
    """(STEPS, N) bool: at which steps a world starts anew; all of them at step 0."""
    resets = rng.random((STEPS, N)) < 0.08
    resets[0] = True
    return resets


@pytest.mark.parametrize("length", [1, 2, 4])
def test_history_repeats_the_first_observation_of_an_episode(length: int) -> None:
    rng = np.random.default_rng(length)
    resets, frames = some_resets(rng), rng.normal(size=(STEPS, N, 7))
    history = ObservationHistory(length)
    for t in range(STEPS):
        history.reset(resets[t])
        seen = history.push(frames[t])
        for i in range(N):
            start = np.flatnonzero(resets[: t + 1, i])[-1]
            wanted = frames[np.maximum(np.arange(t - length + 1, t + 1), start), i]
            np.testing.assert_array_equal(seen[i], wanted)


@pytest.mark.parametrize("execute", [1, 2, 6])
@pytest.mark.parametrize("coefficient", [0.01, 0.5, -0.3, None])
def test_a_plan_is_the_weighted_mean_of_chunks_for_the_step(execute: int, coefficient: float | None) -> None:
    rng = np.random.default_rng(execute)
    resets, chunks = some_resets(rng), rng.normal(size=(STEPS, N, TA, DA)).astype(np.float32)
    plan = ActionPlan(TA, execute, coefficient)
    planned: list[list[int]] = [[] for _ in range(N)]  # steps at which each world planned, in this episode
    for t in range(STEPS):
        plan.reset(resets[t])
        due = plan.due(N)
        plan.add(chunks[t, due], due)
        actions = plan.pop()
        for i in range(N):
            planned[i] = [] if resets[t, i] else planned[i]
            assert due[i] == (not planned[i] or t - planned[i][-1] >= execute)
            planned[i] += [t] if due[i] else []
            reaching = [s for s in planned[i] if t - s < TA]
            proposals = np.array([chunks[s, i, t - s] for s in reaching], np.float64)
            weights = np.exp(-(coefficient or 0.0) * np.arange(len(reaching)))
            weights = np.eye(len(reaching))[-1] if coefficient is None else weights / weights.sum()
            np.testing.assert_allclose(actions[i], weights @ proposals, atol=1e-5)


def test_a_world_forgets_completely_when_reset() -> None:
    """Its first action is bit-equal to the chunk's, so results do not depend on who flew in the world before."""
    rng = np.random.default_rng(0)
    plan, mask = ActionPlan(TA), np.array([True, False])
    for _ in range(7):
        plan.add(rng.normal(scale=1e3, size=(2, TA, DA)).astype(np.float32), np.ones(2, bool))
        plan.pop()
    plan.reset(mask)
    chunk = rng.normal(size=(2, TA, DA)).astype(np.float32)
    plan.add(chunk, np.ones(2, bool))
    np.testing.assert_array_equal(plan.pop()[0], chunk[0, 0])


@pytest.mark.parametrize("execute", [0, TA + 1])
def test_execute_must_fit_into_the_chunk(execute: int) -> None:
    with pytest.raises(InvalidValueError, match=r"\[1, 6\]"):
        ActionPlan(TA, execute)
