"""An error of another process arrives as what it was."""

from __future__ import annotations

import pickle
from collections.abc import Iterator

import pytest

from aerial_il.core import errors
from aerial_il.core.errors import AerialError

EXAMPLES: list[AerialError] = [
    AerialError("as it is"),
    errors.UnknownNameError("robot", "fa_hex", ["fa_hexa_arm4"], "See: aerial-il list"),
    errors.InvalidValueError("too large"),
    errors.SimulationDivergedError("qacc of DOF 3", seed=4, step=7),
    errors.CheckpointError("a.pt", "it is cut.", "Train it again."),
    errors.NonFiniteActionError("network output", [3, 1]),
    errors.TrainingDivergedError("loss", step=9),
    errors.NoRewardError(200_000, 0.0, "Show more demonstrations."),
    errors.DemoError("a.mcap", "it is cut.", topic="obs", step=3, expected=4, got=5),
    errors.StorageError("a.mcap", OSError(28, "No space left on device")),
]


def subclasses(kind: type[AerialError]) -> Iterator[type[AerialError]]:
    for each in kind.__subclasses__():
        yield each
        yield from subclasses(each)


@pytest.mark.parametrize("error", EXAMPLES, ids=lambda error: type(error).__name__)
def test_an_error_survives_the_way_to_another_process(error: AerialError) -> None:
    arrived = pickle.loads(pickle.dumps(error))
    assert type(arrived) is type(error)
    assert str(arrived) == str(error)
    assert {name: str(value) for name, value in vars(arrived).items()} == {k: str(v) for k, v in vars(error).items()}


def test_no_kind_of_error_is_left_out() -> None:
    ours = {kind for kind in subclasses(AerialError) if kind.__module__ == errors.__name__}
    assert {type(error) for error in EXAMPLES} == ours | {AerialError}
