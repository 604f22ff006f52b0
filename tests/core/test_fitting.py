"""A value of another type than its setting declares is answered by name; what is meant for it passes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import pytest

from aerial_il.cli.main import main
from aerial_il.core.composition import fits


@dataclass
class Inner:
    rate: float = 0.1


@pytest.mark.parametrize(
    ("hint", "good", "bad"),
    [
        (int, [0, -3], [1.5, True, "1", None, [1], {}]),
        (float, [1, 0.5, float("nan")], [True, "x", None, []]),
        (bool, [True], [1, "true", None]),
        (str, ["", "x"], [1, None, []]),
        (int | None, [None, 2], ["x", 0.5]),
        (tuple[int, ...], [[], [1, 2], (3,)], [[1, "x"], 1, "12", None]),
        (tuple[int, int], [[1, 2]], [[1], [1, 2, 3], [[1], 2]]),
        (list[str], [["a"]], [[["a"]], "a", [None]]),
        (Literal["hand", "script"], ["hand"], ["foot", 1, []]),
        (Mapping[str, float], [{}, {"a": 1}], [{"a": "x"}, [], 3]),
        (Inner, [Inner()], [3, "x", [], None]),
        (Any, [3, "x", None, []], []),
    ],
)
def test_values_fit_or_do_not(hint: Any, good: list[Any], bad: list[Any]) -> None:
    assert [value for value in good if not fits(value, hint)] == []
    assert [value for value in bad if fits(value, hint)] == []


def test_on_the_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", "result=[[1]]"]) == 2
    assert "result=[[1]] is not a list such as [a,b]" in capsys.readouterr().err
    assert main(["train", "dataset=nowhere", "run=x", "algorithm.patience=[2]"]) == 2
    assert "patience=[2] is not a whole number" in capsys.readouterr().err
