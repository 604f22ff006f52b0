"""Pictures of a flight for the gallery: a film of its most eventful seconds, a poster, and what the cameras see.

Films are named after their content: made once, used again as long as scene and flight stay the same bit for bit.
"""

import hashlib
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aerial_il.core.files import write_atomic
from aerial_il.data.episode import Episode
from aerial_il.presentation.films.scene_renderer import SceneRenderer
from aerial_il.presentation.films.traces import traces_of
from aerial_il.presentation.films.video import jpeg, rate_of, write_mp4
from aerial_il.presentation.studio.studio import QUICK, STILL
from aerial_il.presentation.studio.viewpoint import Viewpoint

RECIPE = "3"  # part of every name: raise it when the pictures below are made in another way
LONGEST_S = 6.0
HOLD_S = 0.8
FILM_SIZE = (300, 400)  # height, width
POSTER_SIZE = (480, 640)
STILL_SIZE = (180, 240)
FPS, EXPOSURES = 12.5, QUICK  # pictures a second, and exposures of each
TRAIL_S = 2.0
SHORT_S, SHORT_FPS, SHORT_SIZE = 4.0, 8.0, (216, 288)  # of a film that is one of several on a page


@dataclass(frozen=True)
class Excerpt:
    """The steps of a flight that are shown: ``first`` to ``last``, and the one on the poster."""

    first: int
    last: int
    poster: int


@dataclass(frozen=True)
class FlightClips:
    """Files on disk that show a flight.

    Attributes:
        film: MP4. poster: JPEG of the moment that shows most. portrait: JPEG of the robot alone.
        stills: camera -> JPEG of what it sees at that moment.
    """

    film: Path
    poster: Path
    portrait: Path
    stills: dict[str, Path]

    @property
    def files(self) -> tuple[Path, ...]:
        return (self.film, self.poster, self.portrait, *self.stills.values())


def make_clips(episode: Episode, subtasks: np.ndarray, folder: Path) -> FlightClips:
    """Return the pictures of a flight, made now or before.

    Args:
        episode: a flight with its states. subtasks: (T, K) flags after each step. folder: where they are kept.
    """
    part = excerpt(subtasks, episode.spec.control_dt_s)
    stem = f"{episode.spec.robot}-{episode.spec.task}-"
    name = stem + digest_of(episode, part)
    with SceneRenderer(episode.model_xml) as scene:
        clips = FlightClips(
            film=folder / f"{name}.mp4",
            poster=folder / f"{name}-poster.jpg",
            portrait=folder / f"{name}-robot.jpg",
            stills={camera: folder / f"{name}-{camera}.jpg" for camera in scene.cameras},
        )
        if all(file.exists() for file in clips.files):
            return clips
        for old in folder.glob(f"{stem}*"):
            old.unlink()
        _make(clips, scene, episode, part)
    return clips


def short_film(episode: Episode, path: Path) -> int:
    """Write a film of a whole flight that lasts some seconds, and return how many times faster than real time it is.

    Args:
        episode: a flight with its states. path: MP4 file.
    """
    dt = episode.spec.control_dt_s
    stride, rate = rate_of(dt, SHORT_FPS)
    speed = math.ceil(len(episode) * dt / SHORT_S)
    with SceneRenderer(episode.model_xml) as scene:
        view = scene.frame(episode.states, SHORT_SIZE[1] / SHORT_SIZE[0])
        frames = _frames(scene, episode, range(0, len(episode) + 1, stride * speed), view, SHORT_SIZE)
        write_mp4(path, frames, rate=rate, hold_frames=round(HOLD_S * rate))
    return speed


def excerpt(subtasks: np.ndarray, dt: float) -> Excerpt:
    """Choose the seconds in which most sub-tasks (T, K) are done for the first time, the latest such seconds."""
    length, most = len(subtasks), round(LONGEST_S / dt)
    done = sorted(int(np.argmax(flags)) for flags in subtasks.T if flags.any())
    ends = [length - 1, *(min(length - 1, step + round(1.0 / dt)) for step in done)]

    def events(end: int) -> list[int]:
        return [step for step in done if end - most < step <= end]

    last = max(ends, key=lambda end: (len(events(end)), end))
    shown = events(last)
    first = max(0, last - most + 1)
    return Excerpt(first, last, shown[-2] if len(shown) > 1 else shown[0] if shown else (first + last) // 2)


def _make(clips: FlightClips, scene: SceneRenderer, episode: Episode, part: Excerpt) -> None:
    after = episode.states[1:]
    shown = after[part.first : part.last + 1]
    view = scene.frame(shown, FILM_SIZE[1] / FILM_SIZE[0])
    stride, rate = rate_of(episode.spec.control_dt_s, FPS)
    steps = range(part.first + 1, part.last + 2, stride)
    write_mp4(clips.film, _frames(scene, episode, steps, view), rate=rate, hold_frames=round(HOLD_S * rate))
    moment, aspect = after[part.poster], POSTER_SIZE[1] / POSTER_SIZE[0]
    _save(clips.poster, scene.draw(moment, scene.frame([moment], aspect), *POSTER_SIZE, exposures=STILL))
    for camera, path in clips.stills.items():
        _save(path, scene.draw(moment, camera, *STILL_SIZE))
    scene.hide_props()
    alone = scene.frame([moment], aspect, props=False)
    _save(clips.portrait, scene.draw(moment, alone, *POSTER_SIZE, exposures=STILL))


def _frames(
    scene: SceneRenderer, episode: Episode, steps: range, view: Viewpoint, size: tuple[int, int] = FILM_SIZE
) -> Iterator[np.ndarray]:
    traces = traces_of(episode, scene)
    for step in steps:
        marks = traces.marks(step, since_s=TRAIL_S)
        yield scene.draw(episode.states[step], view, *size, exposures=EXPOSURES, marks=marks)


def _save(path: Path, picture: np.ndarray) -> None:
    write_atomic(path, jpeg(picture))


def digest_of(episode: Episode, part: Excerpt) -> str:
    """Return what the names of a flight's files end in: equal for equal pictures."""
    content = hashlib.sha256(f"{RECIPE} {part} {episode.model_xml}".encode())
    content.update(np.ascontiguousarray(episode.states).tobytes())
    return content.hexdigest()[:12]
