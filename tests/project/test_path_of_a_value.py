"""A setting reaches the algorithm by a short way: few functions and files of the package hand it on."""

import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import FrameType

import pytest

import aerial_il
from aerial_il.algorithms.sac import SAC
from aerial_il.cli.main import main

PACKAGE = str(Path(aerial_il.__file__).parent)
OWN_CHECKS = (f"{PACKAGE}/algorithms/", f"{PACKAGE}/core/checks.py")  # of an algorithm's settings, by itself
LR = 0.001234567
DEPTH = 6  # of containers that are looked into


def carries(value: object, depth: int = DEPTH) -> bool:
    """Whether ``value`` is the learning rate, holds it, or is a word that says it."""
    if isinstance(value, float):
        return value == LR
    if isinstance(value, str):
        return str(LR) in value and len(value) < 1000
    if depth == 0:
        return False
    if isinstance(value, dict):
        return any(carries(each, depth - 1) for each in value.values())
    if isinstance(value, list | tuple):
        return any(carries(each, depth - 1) for each in value)
    inner = getattr(value, "__dict__", None) if type(value).__module__.startswith("aerial_il") else None
    return (
        inner is not None and not isinstance(value, type) and any(carries(each, depth - 1) for each in inner.values())
    )


def way(call: Callable[[], object]) -> tuple[set[tuple[str, str]], set[str]]:
    """Return the functions, and their files, that are given the value before the algorithm's ``train`` is entered.

    What the algorithm itself does to check its settings is left out.
    """
    functions, done = set[tuple[str, str]](), list[bool]()

    def note(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        ours = code.co_filename.startswith(PACKAGE) and not code.co_filename.startswith(OWN_CHECKS)
        if event != "call" or done or not ours or code.co_name.startswith("<"):
            return
        names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount + 2]
        if any(carries(frame.f_locals[name]) for name in names if name in frame.f_locals):
            functions.add((code.co_filename, code.co_qualname))

    def reached(self: SAC, *_: object, **__: object) -> None:
        assert self.lr == LR
        done.append(True)
        raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SAC, "train", reached)
        sys.setprofile(note)
        try:
            with suppress(KeyboardInterrupt):
                call()
        finally:
            sys.setprofile(None)
    assert done
    return functions, {file for file, _ in functions}


POLICY, ENV = "squashed_gaussian", "gymnasium:Pendulum-v1"


def test_from_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    typed = ["train", "algorithm=sac", f"algorithm.lr={LR}", f"policy={POLICY}", f"env={ENV}", "run=typed"]
    functions, files = way(lambda: main(typed))
    assert len(functions) <= 18, sorted(functions)
    assert len(files) <= 9, sorted(files)


@pytest.mark.parametrize("algorithm", [{"name": "sac", "lr": LR}, SAC(lr=LR)], ids=["mapping", "settings"])
def test_from_python(algorithm: object, tmp_path: Path) -> None:
    functions, files = way(
        lambda: aerial_il.train(run=tmp_path / "called", algorithm=algorithm, policy=POLICY, env=ENV)
    )
    assert len(functions) <= 10, sorted(functions)
    assert len(files) <= 7, sorted(files)
