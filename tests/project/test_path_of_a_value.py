"""A setting reaches the algorithm by a short way: few functions and files of the package hand it on."""

from __future__ import annotations

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
    """Return the functions, and their files, that hand the value on until the algorithm's ``train`` is entered.

    That is whoever was given it and gave it to another function of the package, or handed it back, as it is or made
    into something else. Who only looks at it, as a check of its range does, is not on its way.
    """
    given, functions, done = set[int](), set[tuple[str, str]](), list[bool]()

    def ours(frame: FrameType | None) -> bool:
        code = frame.f_code if frame is not None else None
        return code is not None and code.co_filename.startswith(PACKAGE) and not code.co_name.startswith("<")

    def note(frame: FrameType, event: str, result: object) -> None:
        if done or event not in ("call", "return") or not ours(frame):
            return
        code = frame.f_code
        names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount + 2]
        if event == "return" and id(frame) in given and carries(result):
            functions.add((code.co_filename, code.co_qualname))
        if event == "return" or not any(carries(frame.f_locals[name]) for name in names if name in frame.f_locals):
            return
        given.add(id(frame))
        caller = frame.f_back
        while caller is not None and not ours(caller):
            caller = caller.f_back
        if caller is not None and id(caller) in given:
            functions.add((caller.f_code.co_filename, caller.f_code.co_qualname))

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
