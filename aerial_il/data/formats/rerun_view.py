"""Recordings in the rerun viewer, which reads our MCAP files as they are."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from aerial_il.core.errors import DemoError


def convert(recording: Path, target: Path) -> Path:
    """Write a recording as rerun's own file, which opens faster and in a browser.

    Args:
        recording: an MCAP file. target: the .rrd file.

    Raises:
        DemoError: rerun is not installed, or cannot read the recording.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    words = [_program(recording), "mcap", "convert", str(recording), "-o", str(target)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode or not target.exists():
        said = done.stderr.strip().splitlines()
        raise DemoError(recording, f"rerun cannot convert it: {said[-1] if said else f'status {done.returncode}'}.")
    return target


def open_viewer(recording: Path) -> None:
    """Start the viewer with a recording, as a program of its own."""
    subprocess.Popen(
        [_program(recording), str(recording)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def _program(recording: Path) -> str:
    """Return the viewer's path beside this Python."""
    program = Path(sys.executable).with_name("rerun")
    if not program.exists():
        hint = "Install rerun-sdk, or watch it with viewer=page."
        raise DemoError(recording, f"cannot be shown in rerun: there is no {program}.", hint=hint)
    return str(program)
