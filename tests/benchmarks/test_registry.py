"""Every benchmark is found by its file, asks a question and can be told its settings."""

from __future__ import annotations

from dataclasses import fields, is_dataclass

import pytest

from aerial_il import benchmarks
from aerial_il.core.errors import UnknownNameError


@pytest.mark.parametrize("name", benchmarks.names())
def test_a_benchmark_is_what_its_file_says(name: str) -> None:
    benchmark = benchmarks.get(name)
    assert benchmark.name == name
    assert benchmark.question.endswith("?")
    assert is_dataclass(benchmark)
    assert fields(benchmark)
    assert benchmark() == benchmark(), "settings are values"


def test_an_unknown_benchmark_is_answered_with_the_nearest() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'tracking'"):
        benchmarks.get("traking")
