"""The browser, for tests that are left out where there is none."""

from __future__ import annotations

import pytest

from aerial_il.presentation.rerun.chromium import BROWSER, Opener, Tab, browser

needs_browser = pytest.mark.skipif(BROWSER is None, reason="no Chromium or Chrome on this machine")

__all__ = ["Opener", "Tab", "browser", "needs_browser"]
