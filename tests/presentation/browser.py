"""A real browser without a window, where one is installed."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.patience import HANG_S

BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
needs_browser = pytest.mark.skipif(BROWSER is None, reason="no Chromium or Chrome on this machine")
OPTIONS = ["--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]


def picture(page: Path, target: Path, *, dark: bool = False) -> np.ndarray:
    """Return the top of the page as grey values (H, W)."""
    scheme = f"--blink-settings=preferredColorScheme={0 if dark else 1}"
    _run([*OPTIONS, "--window-size=900,1400", scheme, f"--screenshot={target}", page.as_uri()])
    return np.asarray(Image.open(target).convert("L"), dtype=float)


def dom_after(page: Path, script: str) -> str:
    """Return the page's elements after its own scripts and then ``script`` have run."""
    with_script = page.with_name(f"{page.stem}_scripted.html")
    with_script.write_text(page.read_text().replace("</body>", f"<script>{script}</script></body>"))
    return _run([*OPTIONS, "--virtual-time-budget=3000", "--dump-dom", with_script.as_uri()])


def _run(options: list[str]) -> str:
    assert BROWSER is not None
    return subprocess.run([BROWSER, *options], check=True, capture_output=True, text=True, timeout=HANG_S).stdout
