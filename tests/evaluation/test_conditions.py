"""Two evaluations under other conditions are compared with a word on what differs."""

from dataclasses import replace
from typing import Any

import pytest

from aerial_il.evaluation.compare import other_conditions
from aerial_il.evaluation.result import EvaluationResult


def test_other_latency_and_execution_are_named(diver: EvaluationResult) -> None:
    told = {"latency": {"action_delay_ms": 40}, "execution": {"chunks": "dropped"}}
    environment = {**diver.provenance["environment"], **told}
    late = replace(diver, provenance={**diver.provenance, "environment": environment})
    assert other_conditions(diver, diver) == other_conditions(late, late) == []
    latency, execution = other_conditions(diver, late)
    assert "latency differs: none of a, {'action_delay_ms': 40} of b" in latency
    assert "execution differs: none of a, {'chunks': 'dropped'} of b" in execution


@pytest.mark.parametrize(
    "told",
    [{"max_steps": 9}, {"controller": "another"}, {"instruction": "Do it."}, {"options": {"success": "return:9"}}],
)
def test_whatever_else_differs_is_named(diver: EvaluationResult, told: dict[str, Any]) -> None:
    environment = {**diver.provenance["environment"], **told}
    other = replace(diver, provenance={**diver.provenance, "environment": environment})
    (note,) = other_conditions(diver, other)
    assert next(iter(told)) in note
