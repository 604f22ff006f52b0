"""A window of its own: a real browser shows the page in it; without one the error says what to install."""

from __future__ import annotations

from pathlib import Path

import pytest

from aerial_il.teleop.web.window import NoWindowError, open_window, window_program
from tests.patience import until
from tests.teleop.chromium import needs_browser
from tests.teleop.flown import flown


def test_without_a_browser_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(NoWindowError, match="apt install chromium"):
        window_program()


@needs_browser
@pytest.mark.browser
@pytest.mark.render
async def test_the_page_comes_up_in_it(tmp_path: Path) -> None:
    """Without a screen, so the window itself was never seen; that its page connects is."""
    options = ("--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}")
    async with flown(tmp_path / "out") as flight:
        process = open_window(window_program(), flight.server.url, options)
        try:
            await until(lambda: flight.server.visitors.controller is not None)
        finally:
            process.terminate()
            process.wait()
