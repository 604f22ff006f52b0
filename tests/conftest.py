"""What all tests share: a rendering back end, chosen before any test module imports MuJoCo, or else no pictures."""

from __future__ import annotations

import logging
from collections.abc import Iterator

import pytest

from aerial_il.core.rendering import can_render, choose_backend

choose_backend()


@pytest.fixture(autouse=True)
def _skip_without_rendering(request: pytest.FixtureRequest) -> None:
    if request.node.get_closest_marker("render") and not can_render():
        pytest.skip("no rendering back end on this machine")


@pytest.fixture(autouse=True)
def _package_logger() -> Iterator[None]:
    """Undo what a command does to the package's logger, so that no test depends on those before it."""
    logger = logging.getLogger("aerial_il")
    before = (logger.handlers[:], logger.propagate, logger.level)
    yield
    logger.handlers, logger.propagate = before[0], before[1]
    logger.setLevel(before[2])
