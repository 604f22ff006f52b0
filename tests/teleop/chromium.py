"""The browser, for tests that are left out where there is none."""

import pytest

from aerial_il.presentation.rerun.chromium import BROWSER
from experiments.teleop.hands import Opener, Tab, browser
from tests.patience import HANG_S

Tab.patience_s = HANG_S  # a busy machine fails no test

needs_browser = pytest.mark.skipif(BROWSER is None, reason="no Chromium or Chrome on this machine")

__all__ = ["Opener", "Tab", "browser", "needs_browser"]
