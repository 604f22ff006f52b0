"""Tests that are coroutines are run, each in a loop of its own."""

import asyncio
import inspect

import pytest

from aerial_il.teleop.devices import leader_arm, spacemouse
from aerial_il.teleop.input import inbox
from aerial_il.teleop.piloting import assist
from tests.patience import HANG_S


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run a test that is a coroutine; no clock decides it, but one that hangs is ended."""
    if not inspect.iscoroutinefunction(pyfuncitem.obj):
        return None
    wanted = inspect.signature(pyfuncitem.obj).parameters
    work = pyfuncitem.obj(**{name: pyfuncitem.funcargs[name] for name in wanted})
    asyncio.run(asyncio.wait_for(work, HANG_S))
    return True


@pytest.fixture
def unhurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no dead man's switch act for a page that is slow, as on a busy machine; for tests that are not of it."""
    monkeypatch.setattr(assist, "STALE_TICKS", 1_000_000)


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take no device for silent that a busy machine has not heard yet."""
    for module in (inbox, leader_arm, spacemouse):
        monkeypatch.setattr(module, "STALE_S", HANG_S)
    monkeypatch.setattr(leader_arm, "SILENT_S", HANG_S)
