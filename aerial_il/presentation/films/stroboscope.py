"""A flight in one picture: several moments of it at once, older ones paler, with the tool's and the base's trails."""

import os
from pathlib import Path

import numpy as np

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import write_atomic
from aerial_il.data.episode import Episode
from aerial_il.presentation.films.scene_renderer import SceneRenderer
from aerial_il.presentation.films.traces import Traces, traces_of
from aerial_il.presentation.films.video import png
from aerial_il.presentation.studio.marks import Ghost, Mark
from aerial_il.presentation.studio.studio import STILL

STILL_SIZE = (720, 1280)  # height, width
LARGEST = 4096
MOMENTS, APART_M = 5, 0.28  # at most so many moments, so far apart
PALEST = 0.62


def write_stroboscope(path: str | os.PathLike[str], episode: Episode, *, size: tuple[int, int] = STILL_SIZE) -> Path:
    """Write the picture of a recorded flight as PNG; return its path.

    Args:
        path: of the picture. episode: with its states. size: height and width, pixels.

    Raises:
        InvalidValueError: ``size`` cannot be drawn.
    """
    if not all(16 <= pixels <= LARGEST for pixels in size):
        raise InvalidValueError(f"size={list(size)}: height and width lie in [16, {LARGEST}], e.g. size=[1080,1920].")
    return write_atomic(Path(path), png(stroboscope(episode, *size)))


def stroboscope(episode: Episode, height: int, width: int) -> np.ndarray:
    """Return the picture (height, width, 3) uint8 of a recorded flight."""
    with SceneRenderer(episode.model_xml) as scene:
        traces = traces_of(episode, scene)
        chosen = moments(traces)
        view = scene.frame(episode.states, width / height)
        marks: list[Mark] = [*traces.marks(chosen[-1], since_s=len(episode) * traces.dt)]
        for k, step in enumerate(chosen[:-1]):
            marks.append(Ghost(episode.states[step], PALEST * (1.0 - k / len(chosen))))
        return scene.draw(episode.states[chosen[-1]], view, height, width, exposures=STILL, marks=marks)


def moments(traces: Traces) -> list[int]:
    """Choose the states that are shown: the last, and earlier ones evenly along the way of base and tool."""
    moved = np.linalg.norm(np.diff(traces.base, axis=0), axis=1) + np.linalg.norm(np.diff(traces.tool, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(0.5 * moved)])
    count = int(np.clip(way[-1] / APART_M, 1, MOMENTS - 1))
    steps = np.searchsorted(way, np.linspace(0.0, way[-1], count + 1))
    far: list[int] = []
    for step in reversed(steps.tolist()):
        if all(np.linalg.norm(traces.base[step] - traces.base[other]) > 0.6 * APART_M for other in far):
            far.append(min(step, len(way) - 1))
    return far[::-1]
