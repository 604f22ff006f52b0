"""``aerial-il teleop`` as it is typed: it says where the page is, ends by Ctrl-C, and refuses what cannot be."""

import os
import signal
import socket
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

import aerial_il
from aerial_il.cli.main import BAD_USAGE, main
from aerial_il.core.errors import InvalidValueError
from aerial_il.workflows import teleop
from aerial_il.workflows.teleop import ROBOT, TASK, _flown_once
from tests.patience import HANG_S

# In a process of its own: what compiles, how often, and on which thread.
COMPILES = """
import threading
import numpy as np
import aerial_il
from aerial_il.workflows.teleop import _flown_once
from aerial_il.suite.episode import simulation

compiled = []
plain = simulation.entry_of

def counted(function, *arguments):
    compiled.append((function.__name__, threading.current_thread() is threading.main_thread()))
    return plain(function, *arguments)

simulation.entry_of = counted
env = _flown_once(aerial_il.load_batch(ROBOT, TASK, num_envs=1, num_threads=1))
before = list(compiled)
assert ("fly", True) in before, before
for seed in range(2):
    env.reset(seed)
    env.step(np.zeros((1, env.spec.action.size)))
assert compiled == before, compiled
"""


def test_what_flies_is_compiled_before_anybody_flies() -> None:
    """On the thread that flies, half a minute of compiling would keep Ctrl-C waiting and the page still."""
    code = COMPILES.replace("ROBOT", repr(ROBOT)).replace("TASK", repr(TASK))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_what_nobody_flies_by_hand_is_refused_before_it_is_flown() -> None:
    env = aerial_il.load_batch(ROBOT, TASK, num_envs=2, num_threads=1)
    try:
        with pytest.raises(InvalidValueError, match="a person flies one world"):
            _flown_once(env)
    finally:
        env.close()


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
        ("devices=[spacemouse] hardware=[spacemouse.path:3]", "hardware.spacemouse.path=3 is not text"),
        ("devices=[spacemouse] hardware=[spacemouse.pat:/dev/hidraw3]", "hardware.spacemouse.path"),
        ("certificate=x.pem", "key_file"),
        ("port=-1", "port"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], word: str, message: str) -> None:
    assert main(["teleop", f"out={tmp_path / 'ds'}", *word.split()]) == BAD_USAGE
    assert message in capsys.readouterr().err


@pytest.mark.render
def test_a_device_that_is_not_plugged_in_is_told_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
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
def test_a_page_for_others_has_a_fingerprint_or_warns(
    tls: bool | None, expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    context = teleop._tls(teleop.Teleop(out="x", host="0.0.0.0", expose=True, tls=tls))
    assert (context is None) == (tls is False)
    assert expected in capsys.readouterr().out
    assert teleop._tls(teleop.Teleop(out="x")) is None
    assert not capsys.readouterr().out
