"""``aerial-il teleop`` as it is typed: it says where the page is, ends by Ctrl-C, and refuses what cannot be."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from aerial_il.cli.main import BAD_USAGE, main


@pytest.mark.render
def test_it_says_where_the_page_is_serves_it_and_ends_by_ctrl_c(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "aerial_il", "teleop", f"out={tmp_path / 'ds'}", "port=0", "task=reach"]
    quiet = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=quiet)
    try:
        assert process.stdout is not None
        url = process.stdout.readline().removeprefix("Fly here: ").strip()
        tunnel = process.stdout.readline()
        with urllib.request.urlopen(url, timeout=20) as answer:
            assert b"app.js" in answer.read()
        assert f"ssh -N -L {url.split(':')[2].split('/')[0]}:127.0.0.1:" in tunnel
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=30)
    finally:
        process.kill()
    assert "0 demonstrations, 0 failures, 0 in the trash" in out
    assert "Traceback" not in err
    assert process.returncode == 0


@pytest.mark.parametrize(
    ("word", "told"),
    [
        ("action=rotor", "velocity"),
        ("devices=[keybord]", "keyboard"),
        ("host=0.0.0.0", "this machine alone"),
        ("time_scale=3", "0.25"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], word: str, told: str) -> None:
    assert main(["teleop", f"out={tmp_path / 'ds'}", word]) == BAD_USAGE
    assert told in capsys.readouterr().err
