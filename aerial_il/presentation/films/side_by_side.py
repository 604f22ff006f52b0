"""Recorded flights side by side in one animated picture, WebP: for pages that play no video."""

import io
import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import batched
from pathlib import Path

import numpy as np
from PIL import Image

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import write_atomic
from aerial_il.core.places import MADE_BY
from aerial_il.core.progress import Progress
from aerial_il.data.episode import Episode
from aerial_il.presentation.films.overlay import compose
from aerial_il.presentation.films.scene_renderer import SceneRenderer
from aerial_il.presentation.films.video import caption_of

HOLD_S = 0.8  # the last pictures of a round stand this long
GAP = 4  # pixels between two pictures
SMALLEST, FASTEST = 64, 50.0  # pixels each way; pictures a second
EFFORT = 4  # of the encoder, 0 to 6


@dataclass(frozen=True)
class Look:
    """What the animation looks like.

    Attributes:
        height, width: of one flight's picture, pixels. fps: pictures a second. quality: of WebP, 0 to 100.
        abreast: flights at once; the next so many follow them.
    """

    height: int = 280
    width: int = 280
    fps: float = 12.5
    quality: int = 60
    abreast: int = 3

    def __post_init__(self) -> None:
        if min(self.height, self.width) < SMALLEST:
            raise InvalidValueError(f"height is {self.height}, width {self.width}; both must be at least {SMALLEST}.")
        if not 0.0 < self.fps <= FASTEST:
            raise InvalidValueError(f"fps is {self.fps:g}; it must lie in (0, {FASTEST:g}], one for each step.")
        if not 0 <= self.quality <= 100:
            raise InvalidValueError(f"quality is {self.quality}; it must lie in [0, 100].")
        if self.abreast < 1:
            raise InvalidValueError(f"abreast is {self.abreast}; it must be at least 1.")


class Panel:
    """One flight as it passes in real time, from one viewpoint that holds all of it.

    Args:
        episode: the recording. scene: of it. look: sizes.
    """

    def __init__(self, episode: Episode, scene: SceneRenderer, look: Look) -> None:
        self._episode, self._scene, self._look = episode, scene, look
        self._view = scene.frame(episode.states, look.width / look.height)

    @property
    def duration_s(self) -> float:
        return len(self._episode) * self._episode.spec.control_dt_s

    @cached_property
    def _last(self) -> np.ndarray:
        return self._draw(len(self._episode))

    def at(self, time_s: float) -> np.ndarray:
        """Return the picture (H + strip, W, 3) uint8 after ``time_s``; after its end a flight stands still."""
        return self._last if time_s >= self.duration_s else self._draw(int(time_s / self._episode.spec.control_dt_s))

    def _draw(self, step: int) -> np.ndarray:
        episode, look = self._episode, self._look
        picture = self._scene.draw(episode.states[step], self._view, look.height, look.width)
        caption = replace(caption_of(episode, step), title=episode.spec.task.replace("_", " "))
        return compose({episode.spec.robot: picture}, caption)


def write_side_by_side(
    path: str | os.PathLike[str], episodes: Sequence[Episode], look: Look | None = None, *, progress: bool = False
) -> Path:
    """Write the flights as one animation that repeats for ever, in real time, round after round; return its path.

    Args:
        path: a WebP file. episodes: recordings with their states, ``look.abreast`` to a round.
        look: sizes; None for the defaults. progress: show a progress bar.

    Raises:
        InvalidValueError: the flights fill no whole rounds, or ``path`` is no WebP file.
    """
    look = look or Look()
    if Path(path).suffix != ".webp":
        raise InvalidValueError(f"{path} is not an animation: its name must end in .webp.")
    if not episodes or len(episodes) % look.abreast:
        raise InvalidValueError(
            f"{len(episodes)} flights do not fill a round of {look.abreast}: add some, or set abreast."
        )
    step_s = 1.0 / look.fps
    frames, seconds = [], []
    for flights in batched(episodes, look.abreast):
        shown = list(_round(flights, look, progress))
        frames += shown
        seconds += [step_s] * (len(shown) - 1) + [HOLD_S]
    write_atomic(Path(path), _animation(frames, seconds, look.quality))
    return Path(path)


def _round(episodes: Sequence[Episode], look: Look, progress: bool) -> Iterator[Image.Image]:
    """Yield the pictures of flights that begin together, until the longest of them has ended."""
    with ExitStack() as stack:
        scenes = [stack.enter_context(SceneRenderer(episode.model_xml)) for episode in episodes]
        panels = [Panel(episode, scene, look) for episode, scene in zip(episodes, scenes, strict=True)]
        longest = max(panel.duration_s for panel in panels)
        times = [*np.arange(0.0, longest, 1.0 / look.fps).tolist(), longest]
        for time_s in Progress(times, desc="film", unit="frame", disable=not progress):
            yield _beside([panel.at(time_s) for panel in panels])


def _beside(pictures: Sequence[np.ndarray]) -> Image.Image:
    gap = np.full((len(pictures[0]), GAP, 3), 255, np.uint8)
    parts = [part for picture in pictures for part in (gap, picture)]
    return Image.fromarray(np.concatenate(parts[1:], axis=1))


def _animation(frames: Sequence[Image.Image], seconds: Sequence[float], quality: int) -> bytes:
    """Return a WebP file of pictures that stand for so many seconds each."""
    buffer, first = io.BytesIO(), frames[0]
    shown = [round(1000 * each) for each in seconds]
    first.save(
        buffer,
        "WEBP",
        append_images=frames[1:],
        save_all=True,
        duration=shown,
        loop=0,
        quality=quality,
        method=EFFORT,
        xmp=MADE_BY.encode(),
    )
    return buffer.getvalue()
