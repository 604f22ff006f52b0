"""MuJoCo's rendering back end of this machine, chosen before MuJoCo is imported.

MuJoCo and dm_control read ``MUJOCO_GL`` once, at import. ``make setup`` renders one frame in a child process with
each back end and remembers the first that works; :func:`choose_backend` hands that choice on. A machine without any
runs state-only: everything but cameras and videos works.
"""

import ctypes.util
import os
import subprocess
import sys
from pathlib import Path

from aerial_il.core.errors import AerialError

BACKENDS = ("egl", "osmesa")
DISABLED = "disabled"
PACKAGES = "libegl1 libopengl0 libgl1-mesa-dri"
_OFF = ("off", "disable", "disabled", "false", "0")  # what MuJoCo and dm_control both take for "no pictures"
_ON = ("egl", "osmesa", "glfw", "glx", "wgl", "cgl", "on", "enable", "enabled", "true", "1", "")  # what it takes, too

_ONE_FRAME = """
import mujoco
model = mujoco.MjModel.from_xml_string(
    "<mujoco><worldbody><light pos='0 0 2'/><geom type='box' size='1 1 1'/></worldbody></mujoco>")
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
renderer = mujoco.Renderer(model, 32, 32)
renderer.update_scene(data)
assert renderer.render().any(), "the picture is black"
"""


class RenderingError(AerialError, RuntimeError):
    """A picture was asked for on a machine that cannot draw one."""


def choose_backend() -> str:
    """Set ``MUJOCO_GL`` unless the user did; return its value, empty where MuJoCo's own choice is right.

    Call it before the first ``import mujoco``. Linux only: elsewhere MuJoCo finds the window system by itself.
    """
    if sys.platform != "linux":
        return os.environ.get("MUJOCO_GL", "")
    return os.environ.setdefault("MUJOCO_GL", remembered_backend() or _likely_backend())


def check_backend() -> None:
    """Raise :class:`RenderingError` if ``MUJOCO_GL`` is a word that MuJoCo refuses when it is imported."""
    chosen = os.environ.get("MUJOCO_GL", "").lower().strip()
    if chosen not in (*_ON, *_OFF):
        raise RenderingError(
            f"MUJOCO_GL={chosen} is no back end. Valid: {', '.join(BACKENDS)}, glfw, {DISABLED}; or unset it."
        )


def can_render() -> bool:
    """Whether a back end is chosen at all; ``False`` means state-only."""
    return choose_backend().lower() not in _OFF


def require_rendering(purpose: str) -> None:
    """Raise :class:`RenderingError` if nothing can be drawn here.

    Args:
        purpose: what the pictures are for, e.g. ``"cameras=[wrist]"``.
    """
    if not can_render():
        raise RenderingError(
            f"{purpose} needs rendering, and no back end works on this machine. On Debian run: "
            f"sudo apt-get install -y {PACKAGES}; then: make setup. Everything without cameras works as it is."
        )


def remembered_backend() -> str:
    """Return the result of the last probe (``egl``, ``osmesa``, ``disabled``), or an empty string."""
    try:
        return _memory().read_text().strip()
    except OSError:
        return ""


def probe_backend(backend: str) -> str:
    """Render one frame with ``backend`` in a child process; return the reason it failed, or an empty string."""
    child = subprocess.run(
        [sys.executable, "-c", _ONE_FRAME],
        env={**os.environ, "MUJOCO_GL": backend},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    if child.returncode == 0:
        return ""
    lines = child.stderr.strip().splitlines()
    return lines[-1] if lines else f"exit status {child.returncode}"


def probe() -> str:
    """Try every back end, remember the first that works (or ``disabled``) for this environment, and return it."""
    backend = next((backend for backend in BACKENDS if not probe_backend(backend)), DISABLED)
    memory = _memory()
    memory.parent.mkdir(parents=True, exist_ok=True)
    memory.write_text(backend + "\n")
    return backend


def report_probe() -> int:
    """Probe and print the result: what ``make setup`` runs. Return an exit status, 1 where nothing renders."""
    backend = probe()
    print(f"Rendering: {backend}" if backend != DISABLED else f"Rendering: none works (tried {', '.join(BACKENDS)})")
    return int(backend == DISABLED)


def _memory() -> Path:
    return Path(sys.prefix) / "share" / "aerial_il" / "rendering"


def _likely_backend() -> str:
    """Guess from the libraries that are there, where nobody has probed: a wrong name breaks ``import mujoco``."""
    if ctypes.util.find_library("EGL") and ctypes.util.find_library("OpenGL"):
        return "egl"
    return "osmesa" if ctypes.util.find_library("OSMesa") else DISABLED
