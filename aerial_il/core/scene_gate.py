"""The one door for scenes that this process did not write: those of recordings, shared files and models of robots.

A scene is checked against what is allowed (:mod:`aerial_il.core.mjcf`), then compiled and posed once by a process of
its own, with little memory and time. Only then does this process compile it.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from threading import Lock

import mujoco

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.mjcf import check_scene
from aerial_il.core.xml_tree import parse_xml

MAX_MEMORY_BYTES, MAX_PROCESSOR_S = 2 << 30, 10
SCENE, ASSETS = "scene.xml", "assets"
COMPILE_ERRORS = (ValueError, RuntimeError, mujoco.FatalError)


@lru_cache(maxsize=64)
def admit(xml: str) -> None:
    """Require that a scene is complete in itself and harmless to compile and to draw.

    Raises:
        InvalidValueError: it is not, or MuJoCo cannot compile it.
    """
    root = parse_xml(xml)
    if root.tag != "mujoco":
        raise InvalidValueError(f"it begins with <{root.tag}>, which is no scene of MuJoCo's")
    check_scene(root)
    try_compiling(xml, {})


def compiled(xml: str) -> mujoco.MjModel:
    """Return the model of a scene that may come from anywhere.

    Raises:
        InvalidValueError: as :func:`admit`.
    """
    admit(xml)
    return mujoco.MjModel.from_xml_string(xml)


def try_compiling(xml: str, assets: Mapping[str, bytes]) -> None:
    """Compile a checked scene in a process that may take ``MAX_MEMORY_BYTES`` and ``MAX_PROCESSOR_S``.

    Args:
        assets: contents of the files that it names.

    Raises:
        InvalidValueError: it cannot be compiled so; the message is MuJoCo's.
    """
    with tempfile.TemporaryDirectory(prefix="aerial-il-scene-") as name:
        folder = Path(name)
        (folder / SCENE).write_text(xml, encoding="utf-8")
        (folder / ASSETS).mkdir()
        for file, content in assets.items():
            (folder / ASSETS / file).write_bytes(content)
        problem = _compiler(os.getpid()).problem(folder)
    if problem is None:
        limits = f"{MAX_PROCESSOR_S} s of processor time and {MAX_MEMORY_BYTES >> 30} GB of memory"
        raise InvalidValueError(f"to compile it takes more than the {limits} that a scene may take")
    if problem:
        raise InvalidValueError(f"MuJoCo cannot compile it: {problem}")


class _Compiler:
    """A process that forks for each scene; it ends with the one that started it."""

    def __init__(self) -> None:
        words, threads = [sys.executable, "-I", "-c", COMPILER], {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        self._process = subprocess.Popen(
            words, env={**os.environ, **threads}, cwd=tempfile.gettempdir(), start_new_session=True, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        self._one_at_a_time = Lock()

    def problem(self, folder: Path) -> str | None:
        """Return why the scene in a folder cannot be compiled, nothing if it can, None if it takes too much."""
        assert self._process.stdin
        assert self._process.stdout
        with self._one_at_a_time:
            with suppress(BrokenPipeError):
                print(json.dumps(str(folder)), file=self._process.stdin, flush=True)
            if not (answer := self._process.stdout.readline()):
                _compiler.cache_clear()  # it was killed; the next scene gets another one
        problem: str | None = json.loads(answer or "null")
        return problem


@lru_cache(maxsize=1)
def _compiler(pid: int) -> _Compiler:
    """Return the compiler of the process ``pid``, this one: a fork of another must not talk with that one's."""
    return _Compiler()


COMPILER = f"""
import json, os, resource, sys
from pathlib import Path
import mujoco

def tried(folder):
    resource.setrlimit(resource.RLIMIT_AS, ({MAX_MEMORY_BYTES}, {MAX_MEMORY_BYTES}))
    resource.setrlimit(resource.RLIMIT_CPU, ({MAX_PROCESSOR_S}, {MAX_PROCESSOR_S}))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    try:
        assets = {{path.name: path.read_bytes() for path in (folder / "{ASSETS}").iterdir()}}
        text = (folder / "{SCENE}").read_text(encoding="utf-8")
        model = mujoco.MjSpec.from_string(text, assets=assets).compile()
        mujoco.mj_forward(model, mujoco.MjData(model))
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        return " ".join(str(error).split())[:500] or "it does not say why"
    return ""

for line in sys.stdin:
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        try:
            os.write(writing, json.dumps(tried(Path(json.loads(line)))).encode())
        finally:
            os._exit(0)
    os.close(writing)
    with os.fdopen(reading) as pipe:
        print(pipe.read() or "null", flush=True)
    os.waitpid(child, 0)
"""
