"""What all tests share: a rendering back end, chosen before any test module imports MuJoCo, or else no pictures."""

import gc
import logging
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from aerial_il.core import provenance
from aerial_il.core.rendering import can_render, choose_backend
from aerial_il.suite.physics.thread_pool import CORES

MEMORY, ROOM_BYTES = Path("/dev/shm"), 8 << 30

choose_backend()
os.environ.setdefault(CORES, "1")  # tests run abreast: a test of several threads says how many
os.environ.pop("COLUMNS", None)  # which is set where tests run abreast: tables would be as wide as that
if MEMORY.is_dir() and shutil.disk_usage(MEMORY).free > ROOM_BYTES:
    # Thousands of small files are flushed to the disk, up to 10 ms each; where memory is plenty they lie there.
    os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(MEMORY))
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run in a row what a module asks of one cell, so that an environment is made once and not kept."""
    first = {item.path: number for number, item in reversed(list(enumerate(items)))}
    items.sort(key=lambda item: (first[item.path], *_cell(item)))


def pytest_collection_finish() -> None:
    """Leave modules and collected tests out of every later garbage collection, which took a second each otherwise."""
    gc.collect()
    gc.freeze()


def _cell(item: pytest.Item) -> tuple[str, str]:
    """Return the robot and the task that a test is parametrised with; empty words where there are none."""
    values = item.callspec.params if isinstance(item, pytest.Function) and hasattr(item, "callspec") else {}
    result = values.get("cell", (values.get("robot"), values.get("task")))
    return result if isinstance(result, tuple) and all(isinstance(name, str) for name in result) else ("", "")


@pytest.fixture(autouse=True)
def _skip_without_rendering(request: pytest.FixtureRequest) -> None:
    if request.node.get_closest_marker("render") and not can_render():
        pytest.skip("no rendering back end on this machine")


@pytest.fixture(autouse=True)
def _package_logger() -> None:
    """Undo what a command did to the package's logger, so that no test depends on those before it."""
    logger = logging.getLogger("aerial_il")
    logger.handlers, logger.propagate = [], True
    logger.setLevel(logging.NOTSET)


@pytest.fixture(scope="module")
def no_commit() -> Iterator[None]:
    """Let no recording name a commit: somebody may work on the checkout while one process after the other records."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("GIT_DIR", os.devnull)
        patch.setattr(provenance, "git_state", lambda: None)  # this process may have asked before
        yield
