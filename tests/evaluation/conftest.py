"""One evaluation with all three ends, flown once and shared."""

import pytest

from aerial_il.evaluation.result import EvaluationResult
from aerial_il.evaluation.rollouts import evaluate
from tests.data.crane import CraneBatch, CraneExpert


@pytest.fixture(scope="session")
def diver() -> EvaluationResult:
    """40 seeds of a policy that succeeds, crashes and runs out of time."""
    origin = {"command": "aerial-il evaluate policy=diver"}
    policy = CraneExpert(dive=True)
    return evaluate(CraneBatch(16), policy, range(100, 140), policy_name="diver", origin=origin, progress=False)


@pytest.fixture(scope="session")
def expert() -> EvaluationResult:
    """The same seeds, flown without diving."""
    return evaluate(CraneBatch(16), CraneExpert(), range(100, 140), policy_name="expert", progress=False)
