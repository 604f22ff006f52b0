"""What all tests share: a rendering back end, chosen before any test module imports MuJoCo, or else no pictures."""

from __future__ import annotations

import logging

import pytest
from hypothesis import settings

from aerial_il.core.rendering import can_render, choose_backend

choose_backend()
settings.register_profile("repeatable", derandomize=True)
settings.load_profile("repeatable")


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
