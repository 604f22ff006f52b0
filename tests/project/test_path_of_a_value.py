"""A setting reaches the algorithm by a short way: few functions and files of the package hand it on."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType

import pytest

import aerial_il
from aerial_il.algorithms.bc import BC
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
    """Return the functions, and their files, through which a value comes to the algorithm's ``train``.

    These are the ones that call each other down to it, and those that were given the value and handed it back, as it
    is or made into something else. Who only looks at it, as a check of its range does, is not on its way.
    """
    functions, done = set[tuple[str, str]](), list[bool]()

    def place(frame: FrameType) -> tuple[str, str] | None:
        code = frame.f_code
        ours = code.co_filename.startswith(PACKAGE) and not code.co_name.startswith("<")
        return (code.co_filename, code.co_qualname) if ours else None

    def note(frame: FrameType, event: str, result: object) -> None:
        if event == "return" and not done and (found := place(frame)) and carries(result):
            names = frame.f_code.co_varnames[: frame.f_code.co_argcount + frame.f_code.co_kwonlyargcount + 2]
            if any(carries(frame.f_locals[name]) for name in names if name in frame.f_locals):
                functions.add(found)

    def reached(self: BC, *_: object, **__: object) -> None:
        assert self.lr == LR
        frame: FrameType | None = sys._getframe()
        while (frame := frame.f_back) is not None:
            functions.update(filter(None, [place(frame)]))
        done.append(True)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(BC, "train", reached)
        sys.setprofile(note)
        try:
            call()
        finally:
            sys.setprofile(None)
    assert done
    return functions, {file for file, _ in functions}


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("way")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        flown = {"env": "gymnasium:Pendulum-v1", "policy": "random", "success": "survived", "max_steps": 3}
        aerial_il.collect(out="demos", episodes=2, num_envs=1, progress=False, **flown)
        main(["train", "dataset=demos", "run=once", "algorithm.steps=1", "policy.hidden=[4]", "policy.chunk=1",
              "policy.anchor=null", "progress=false"])  # fmt: skip
        yield folder


def test_from_the_command_line(home: Path) -> None:
    functions, files = way(lambda: main(["train", "dataset=demos", "run=typed", f"algorithm.lr={LR}"]))
    assert len(functions) <= 18, sorted(functions)
    assert len(files) <= 9, sorted(files)


@pytest.mark.parametrize("algorithm", [{"lr": LR}, BC(lr=LR)], ids=["mapping", "settings"])
def test_from_python(algorithm: object, home: Path) -> None:
    functions, files = way(lambda: aerial_il.train("demos", run="called", algorithm=algorithm))
    assert len(functions) <= 10, sorted(functions)
    assert len(files) <= 7, sorted(files)
