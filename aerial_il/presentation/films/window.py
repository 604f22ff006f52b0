"""MuJoCo's own window: a flight in real time, as it is flown or as it was recorded, until the window is closed."""

import os
import sys
import threading
import time
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import count

import mujoco
import numpy as np

from aerial_il.core.contracts import Policy, attach
from aerial_il.core.errors import AerialError
from aerial_il.data.episode import Episode
from aerial_il.presentation.films.scene_renderer import SceneRenderer
from aerial_il.suite.batch import BatchEnvironment

CLOSING_S = 5.0  # a window has this long to close
PAUSE_S = 1.2  # the end of a flight stays this long
INSTEAD = "viewer=page writes a page instead."
SCREENS = ("DISPLAY", "WAYLAND_DISPLAY")


class WindowError(AerialError, RuntimeError):
    """A window was asked for where there can be none."""


def has_screen() -> bool:
    """Whether there seems to be a screen to open a window on."""
    return not sys.platform.startswith("linux") or any(os.environ.get(name) for name in SCREENS)


def show_live(env: BatchEnvironment, policy: Policy, first_seed: int) -> None:
    """Let ``policy`` fly seed after seed in world 0 of ``env``, a batch environment of one world, in a window."""

    def moments() -> Iterator[bool]:
        attach(policy, env)
        for seed in count(first_seed):
            obs = env.reset(seed)
            policy.reset()
            over = False
            while not over:
                result = env.step(policy.act(obs))
                obs = result.obs
                over = bool((result.info["success"] | result.terminated | result.truncated)[0])
                env.data(0)  # brings the window's copy up to date
                yield over

    _run(env.model, env.data(0), moments(), env.spec.control_dt_s)


def show_recording(episode: Episode) -> None:
    """Show a recorded flight again and again in a window."""
    scene = SceneRenderer(episode.model_xml)
    scene.pose(episode.states[0])

    def moments() -> Iterator[bool]:
        while True:
            for step in range(len(episode) + 1):
                scene.pose(episode.states[step])
                yield step == len(episode)

    _run(scene.model, scene.data, moments(), episode.spec.control_dt_s)


def _run(model: mujoco.MjModel, data: mujoco.MjData, moments: Iterator[bool], dt: float) -> None:
    """Step through ``moments``, each of which updates ``data`` and says whether a flight ends there, in real time."""
    import mujoco.viewer

    require_window()
    before = set(threading.enumerate())
    try:
        viewer = mujoco.viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=False)
    except RuntimeError as error:  # macOS wants mjpython
        raise WindowError(f"No window can be opened here ({error}). {INSTEAD}") from error
    drawing = set(threading.enumerate()) - before
    with _awaited(drawing), viewer:
        _aim(viewer.cam, model, data)
        due = time.perf_counter()
        while viewer.is_running():
            with viewer.lock():
                over = next(moments)
            viewer.sync()
            due = max(due + (PAUSE_S if over else dt), time.perf_counter() - dt)
            time.sleep(max(0.0, due - time.perf_counter()))


@contextmanager
def _awaited(threads: Iterable[threading.Thread]) -> Iterator[None]:
    """Afterwards wait for ``threads``: a window that is drawn while the interpreter ends crashes the process."""
    try:
        yield
    finally:
        for thread in threads:
            thread.join(CLOSING_S)


def require_window() -> None:
    """Open and close a hidden window: where that fails, MuJoCo's own would end the process without a word."""
    import glfw

    if sys.platform == "darwin":
        return
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        works = bool(glfw.init())
        if works:
            glfw.window_hint(glfw.VISIBLE, glfw.FALSE)
            hidden = glfw.create_window(64, 64, "aerial-il", None, None)
            glfw.default_window_hints()
            works = bool(hidden)
            if hidden:
                glfw.destroy_window(hidden)
    if not works:
        reason = str(said[-1].message) if said else "GLFW gives no reason"
        raise WindowError(f"No window can be opened here ({reason}). {INSTEAD}")


def _aim(camera: mujoco.MjvCamera, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Look from where the ``scene`` camera stands, at the height of the robot."""
    eye = data.camera("scene").xpos
    away = np.array([0.0, 0.0, data.body("base").xpos[2] * 0.8]) - eye
    distance = float(np.sqrt((away**2).sum()))
    camera.lookat[:], camera.distance = eye + away, distance
    camera.azimuth = np.rad2deg(np.arctan2(away[1], away[0]))
    camera.elevation = np.rad2deg(np.arcsin(away[2] / distance))
