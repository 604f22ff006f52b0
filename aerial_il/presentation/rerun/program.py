"""The program ``rerun``: its window, its page in the browser, and its tools for files."""

import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from aerial_il.core.errors import AerialError

START_S = 20.0
LOOPBACK = "127.0.0.1"
_ADDRESS = re.compile(r"http://\S+?\?url=\S+")


class ViewerError(AerialError, RuntimeError):
    """A viewer that is not there, or does not do what it should."""


def program() -> Path:
    """Return the viewer's program, which is installed beside this Python.

    Raises:
        ViewerError: it is not there.
    """
    viewer = Path(sys.executable).with_name("rerun")
    if not viewer.exists():
        hint = "Install it with: pip install rerun-sdk; or look at the flight without it: aerial-il view recording=PATH"
        raise ViewerError(f"rerun's viewer is not installed: there is no {viewer}. {hint}")
    return viewer


def run(*words: str) -> str:
    """Run one of its tools and return what it said.

    Raises:
        ViewerError: it failed; its last words are in the message.
    """
    done = subprocess.run([program(), *words], capture_output=True, text=True, check=False)
    if done.returncode:
        said = (done.stderr or done.stdout).strip().splitlines()
        raise ViewerError(f"rerun {' '.join(words[:2])} failed: {said[-1] if said else f'status {done.returncode}'}")
    return done.stdout + done.stderr


def open_window(file: Path) -> None:
    """Open a file in a window, which stays when this program ends."""
    quiet = subprocess.DEVNULL
    subprocess.Popen([program(), str(file)], stdout=quiet, stderr=quiet, start_new_session=True)


@contextmanager
def page(file: Path, *, port: int = 0, data_port: int = 0) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Serve a file and the viewer to this machine's browsers; yield the server and the page's address.

    Args:
        port: of the page. data_port: of the data. 0: any that is free.

    Raises:
        ViewerError: it did not start.
    """
    ports = [f"--web-viewer-port={port}", f"--port={data_port or 'auto'}"]
    words = [str(program()), str(file), "--serve-web", f"--bind={LOOPBACK}", *ports]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as server:
        try:
            yield server, _address(server)
        finally:
            server.terminate()


def _address(server: subprocess.Popen[str]) -> str:
    """Return where the page is, as the server says."""
    said, until = [], time.monotonic() + START_S
    assert server.stdout is not None
    for line in server.stdout:
        said.append(line.strip())
        if address := _ADDRESS.search(line):
            return address[0]
        if time.monotonic() > until:
            break
    raise ViewerError(f"rerun's page did not start: {said[-1] if said else 'it said nothing'}")
