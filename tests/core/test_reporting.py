"""What people are told: errors of other processes, progress in a log or on a terminal, and where a run comes from."""

import contextlib
import io
import json
import os
import pickle
import pty
import re
from collections.abc import Iterator

import pytest

from aerial_il.core import errors, progress
from aerial_il.core.errors import AerialError
from aerial_il.core.progress import Progress
from aerial_il.core.provenance import git_state, package_versions, provenance

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


@pytest.fixture(autouse=True)
def _time(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each look at the clock is 10 ms later."""
    ticks = iter(range(10**9))
    monkeypatch.setattr("tqdm.std.time", lambda: next(ticks) / 100)


def test_a_log_gets_a_line_every_few_seconds() -> None:
    log = io.StringIO()
    for _ in Progress(range(3000), desc="convert", unit="ep", file=log):
        pass
    lines = log.getvalue().splitlines()
    assert "\r" not in log.getvalue()
    assert 3 <= len(lines) <= 30.0 / progress.LINE_EVERY_S + 3
    assert all(re.match(r"convert: +\d+%\|.*\| \d+/3000 ", line) for line in lines)
    assert "3000/3000" in lines[-1]
    assert log.getvalue().endswith("\n")


def test_who_wants_none_gets_none() -> None:
    log = io.StringIO()
    assert len(list(Progress(range(3), file=log, disable=True))) == 3
    assert log.getvalue() == ""


def test_a_terminal_gets_one_line_that_moves() -> None:
    reader, writer = pty.openpty()
    with os.fdopen(writer, "w") as terminal:
        for _ in Progress(range(3000), file=terminal, ncols=60):
            pass
    shown = _all_of(reader)
    os.close(reader)
    assert shown.count("\r") > 30


def _all_of(reader: int) -> str:
    """Return all that a terminal was sent, in one part or several; its end, once the writer is closed, is an error."""
    shown = b""
    with contextlib.suppress(OSError):
        while part := os.read(reader, 1 << 16):
            shown += part
    return shown.decode()


def test_provenance_is_json_and_names_the_engine() -> None:
    facts = json.loads(json.dumps(provenance(), allow_nan=False))
    assert facts["packages"]["mujoco"].startswith("3.")
    assert set(facts) == {"packages", "git", "python", "platform", "cpu_count"}


def test_git_state_is_a_full_sha_or_nothing() -> None:
    state = git_state()
    assert state is None or (len(state["sha"]) == 40 and isinstance(state["dirty"], bool))


def test_versions_leave_out_what_is_not_installed() -> None:
    assert all(version for version in package_versions().values())
