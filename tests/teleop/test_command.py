"""``aerial-il teleop`` as it is typed: it says where the page is, ends by Ctrl-C, and refuses what cannot be."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from aerial_il.cli.main import BAD_USAGE, main
from aerial_il.workflows import teleop
from tests.patience import HANG_S


@pytest.mark.render
def test_it_says_where_the_page_is_serves_it_and_ends_by_ctrl_c(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "aerial_il", "teleop", f"out={tmp_path / 'ds'}", "port=0", "task=reach"]
    quiet = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # background jobs hand on their deafness
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=quiet)
    try:
        assert process.stdout is not None
        url = process.stdout.readline().removeprefix("Fly here: ").strip()
        tunnel = process.stdout.readline()
        with urllib.request.urlopen(url, timeout=HANG_S) as answer:
            assert b"app.js" in answer.read()
        assert f"ssh -N -L {url.split(':')[2].split('/')[0]}:127.0.0.1:" in tunnel
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=HANG_S)
    finally:
        signal.signal(signal.SIGINT, before)
        process.kill()
    assert "0 demonstrations, 0 failures, 0 in the trash" in out
    assert "Traceback" not in err
    assert process.returncode == 0


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("action=rotor", "velocity"),
        ("devices=[keybord]", "keyboard"),
        ("host=0.0.0.0", "expose=true"),
        ("time_scale=3", "0.25"),
        ("devices=[keyboard,leader_arm]", "action=base_joint"),
        ("hardware=[spacemouse.path:x]", "among devices"),
        ("hardware=[spacemouse]", "DEVICE.SETTING:VALUE"),
        ("certificate=x.pem", "key_file"),
        ("port=-1", "port"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], word: str, message: str) -> None:
    assert main(["teleop", f"out={tmp_path / 'ds'}", word]) == BAD_USAGE
    assert message in capsys.readouterr().err


@pytest.mark.render
def test_a_device_that_is_not_plugged_in_is_told_before_anything_flies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["teleop", f"out={tmp_path / 'ds'}", "port=0", "open=false"]
    nowhere = f"hardware=[spacemouse.path:{tmp_path / 'hidraw0'}]"
    assert main([*words, "devices=[keyboard,spacemouse]", nowhere]) == BAD_USAGE
    assert "Is it plugged in?" in capsys.readouterr().err
    assert main([*words, "devices=[keyboard,leader_arm]", "action=base_joint"]) == BAD_USAGE
    assert "lerobot-calibrate" in capsys.readouterr().err
    assert not (tmp_path / "ds").exists()


@pytest.mark.render
def test_a_port_that_is_taken_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        assert main(["teleop", f"out={tmp_path / 'ds'}", f"port={port}", "open=false"]) == BAD_USAGE
    assert f"port={port} on 127.0.0.1 is taken" in capsys.readouterr().err


@pytest.mark.parametrize(("tls", "expected"), [(None, "SHA-256 fingerprint"), (False, "WARNING")])
def test_a_page_for_other_machines_tells_its_fingerprint_or_warns(
    tls: bool | None, expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    context = teleop._tls(teleop.Teleop(out="x", host="0.0.0.0", expose=True, tls=tls))
    assert (context is None) == (tls is False)
    assert expected in capsys.readouterr().out
    assert teleop._tls(teleop.Teleop(out="x")) is None
    assert not capsys.readouterr().out
