"""Flights one after another as one film, MP4: each from a camera that follows it, with trails, arrows and a caption."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from aerial_il.core.errors import InvalidValueError
from aerial_il.core.progress import Progress
from aerial_il.data.episode import Episode
from aerial_il.presentation.films.overlay import COLOURS, font
from aerial_il.presentation.films.scene_renderer import SceneRenderer
from aerial_il.presentation.films.traces import traces_of
from aerial_il.presentation.films.video import end_of, write_mp4
from aerial_il.presentation.pages.page import END_WORDS
from aerial_il.presentation.studio.stage import HORIZON
from aerial_il.presentation.studio.viewpoint import Viewpoint

TITLE_S, FADE_S = 3.0, 0.35
SLOWEST, FASTEST = 0.5, 2.0  # times real time; of longer flights the beginning is left out
KEY_S, AHEAD_S, EASE_S = 0.4, 1.0, 0.9  # between framings, seen by each to either side, and smoothed over
SWEEP_DEG, HIGH_DEG, LOW_DEG = 26.0, -26.0, -17.0  # that a camera goes round a flight, and how it comes down
MAX_RATE = 8_000_000  # bit/s
TEXT_INK = (38, 46, 54)


@dataclass(frozen=True)
class ReelLook:
    """What the film looks like.

    Attributes:
        height, width: pixels, even numbers. fps: pictures a second. seconds: of the whole film.
        exposures: of each picture. title, subtitle: on the first pictures; none without a title.
    """

    height: int = 540
    width: int = 960
    fps: float = 25.0
    seconds: float = 60.0
    exposures: int = 4
    title: str = ""
    subtitle: str = ""

    def __post_init__(self) -> None:
        if not all(64 <= pixels <= 4096 and pixels % 2 == 0 for pixels in (self.height, self.width)):
            sizes = f"size=[{self.height},{self.width}]"
            raise InvalidValueError(f"{sizes}: height and width are even numbers from 64 to 4096, e.g. [1080,1920].")
        if not 1.0 <= self.fps <= 50.0:
            raise InvalidValueError(f"fps is {self.fps:g}; it must lie in [1, 50], one for each step.")

    @property
    def title_s(self) -> float:
        return TITLE_S if self.title else 0.0


@dataclass(frozen=True)
class Cut:
    """The part of a flight that is shown: from the state ``first`` to ``last``, ``speed`` times as fast as it was."""

    first: int
    last: int
    speed: float


def write_reel(
    path: str | os.PathLike[str], episodes: Sequence[Episode], look: ReelLook | None = None, *, progress: bool = False
) -> Path:
    """Write recorded flights, one after another, as one film of ``look.seconds``; return its path.

    Args:
        path: an MP4 file. episodes: with their states; :func:`shares` divides the time among them.
        look: sizes; None for the defaults. progress: show a progress bar.

    Raises:
        InvalidValueError: there is less than a second for each flight.
    """
    look = look or ReelLook()
    shown_s = look.seconds - look.title_s
    if not episodes or shown_s < len(episodes):
        raise InvalidValueError(f"seconds={look.seconds:g} is too short for {len(episodes)} flights of a second each.")
    each_s = shares([len(episode) * episode.spec.control_dt_s for episode in episodes], shown_s)
    cuts = [cut_of(episode, share_s) for episode, share_s in zip(episodes, each_s, strict=True)]
    total = sum(len(times(cut, episode, look.fps)) for cut, episode in zip(cuts, episodes, strict=True))
    bar = Progress(total=total, desc="film", unit="frame", disable=not progress)

    def frames() -> Iterator[np.ndarray]:
        yield from title_card(look)
        for cut, episode in zip(cuts, episodes, strict=True):
            for picture in shot(episode, cut, look):
                bar.update(1)
                yield picture

    rate = Fraction(look.fps).limit_denominator(1000)
    write_mp4(Path(path), frames(), rate=rate, max_rate=MAX_RATE)
    bar.close()
    return Path(path)


def shares(lengths_s: Sequence[float], total_s: float) -> list[float]:
    """Return for how long each flight is shown, s: all that it lasts, if an equal share of the time is enough for it.

    What short flights leave goes to long ones. If time is left over, all are shown slower, at half speed at most.
    """
    if (together := sum(lengths_s)) <= total_s:
        slower = min(total_s / together, 1.0 / SLOWEST)
        return [slower * length for length in lengths_s]
    given, left = [0.0] * len(lengths_s), total_s
    for k, i in enumerate(sorted(range(len(lengths_s)), key=lambda i: lengths_s[i])):
        given[i] = min(lengths_s[i], left / (len(lengths_s) - k))
        left -= given[i]
    return given


def cut_of(episode: Episode, share_s: float) -> Cut:
    """Choose what is shown of a flight in ``share_s`` seconds: all, up to twice as fast, or else its last part."""
    dt = episode.spec.control_dt_s
    length = len(episode) * dt
    speed = float(np.clip(length / share_s, SLOWEST, FASTEST))
    shown = min(len(episode), round(share_s * speed / dt))
    return Cut(len(episode) - shown, len(episode), speed)


def times(cut: Cut, episode: Episode, fps: float) -> np.ndarray:
    """Return the states (F,) shown in the pictures of a cut."""
    stride = cut.speed / (fps * episode.spec.control_dt_s)
    return np.round(np.arange(cut.first, cut.last + 1e-9, stride)).astype(int)


def shot(episode: Episode, cut: Cut, look: ReelLook) -> Iterator[np.ndarray]:
    """Yield the pictures of one flight."""
    steps = times(cut, episode, look.fps)
    fade = max(1, round(FADE_S * look.fps))
    with SceneRenderer(episode.model_xml) as scene:
        traces, views = traces_of(episode, scene), camera_path(scene, episode, steps, look.width / look.height)
        for k, (step, view) in enumerate(zip(steps.tolist(), views, strict=True)):
            marks = traces.marks(step, scale=max(0.6, view.distance / 2.0))
            picture = scene.draw(
                episode.states[step], view, look.height, look.width, exposures=look.exposures, marks=marks
            )
            seen = min(1.0, (k + 1) / fade, (len(steps) - k) / fade)
            yield faded(captioned(picture, episode, cut, step), seen)


def camera_path(scene: SceneRenderer, episode: Episode, steps: np.ndarray, aspect: float) -> list[Viewpoint]:
    """Return a viewpoint for each of ``steps`` (F,): round the flight, as near as what happens about then allows."""
    dt = episode.spec.control_dt_s
    keys = np.unique(np.append(np.arange(steps[0], steps[-1], round(KEY_S / dt)), steps[-1]))
    aside = round(AHEAD_S / dt)
    turn = np.interp(keys, [steps[0], steps[-1]], [-0.5 * SWEEP_DEG, 0.5 * SWEEP_DEG])
    height = np.interp(keys, [steps[0], steps[-1]], [HIGH_DEG, LOW_DEG])
    views = []
    for key, azimuth, elevation in zip(keys, turn, height, strict=True):
        window = episode.states[np.clip([key - aside, key, key + aside], steps[0], steps[-1])]
        view = scene.frame(window, aspect, turn_deg=float(azimuth), elevation_deg=float(elevation))
        views.append([*view.centre, view.distance, view.azimuth_deg, view.elevation_deg])
    smooth = _eased(np.array(views), keys * dt)
    at = np.stack([np.interp(steps, keys, column) for column in smooth.T], axis=1)
    return [Viewpoint((x, y, z), distance, azimuth, elevation) for x, y, z, distance, azimuth, elevation in at.tolist()]


def _eased(values: np.ndarray, at_s: np.ndarray) -> np.ndarray:
    """Return (K, C) values taken at ``at_s`` (K,), smoothed over time."""
    weight = np.exp(-0.5 * np.square((at_s[:, None] - at_s) / EASE_S))
    return weight @ values / weight.sum(axis=1, keepdims=True)


def captioned(picture: np.ndarray, episode: Episode, cut: Cut, step: int) -> np.ndarray:
    """Return a picture with who flies what, for how long, and in the end how it went, at its foot."""
    frame = Image.fromarray(picture)
    draw, unit = ImageDraw.Draw(frame, "RGBA"), frame.height / 540
    left, right, foot = 30 * unit, frame.width - 30 * unit, frame.height - 26 * unit
    spec, pace = episode.spec, f"   {cut.speed:.1f}x" if abs(cut.speed - 1.0) > 0.05 else ""
    task, about = spec.task.replace("_", " "), f"{spec.robot}   {spec.tier}{pace}"
    draw.text((left, foot - 22 * unit), task, font=font(round(30 * unit)), fill=TEXT_INK, anchor="ls")
    draw.text((left, foot), about, font=font(round(16 * unit)), fill=(*TEXT_INK, 190), anchor="ls")
    end = end_of(episode) if step == len(episode) else ""
    clock = f"{step * spec.control_dt_s:.1f} s"
    draw.text((right, foot), clock, font=font(round(18 * unit)), fill=TEXT_INK, anchor="rs")
    if end:
        word, ink = END_WORDS[end], tuple(round(0.75 * value) for value in COLOURS[end])
        draw.text((right, foot - 24 * unit), word, font=font(round(22 * unit)), fill=ink, anchor="rs")
    share = (step - cut.first) / max(1, cut.last - cut.first)
    draw.rectangle((0, frame.height - 4 * unit, frame.width * share, frame.height), fill=COLOURS[end])
    return np.asarray(frame)


def title_card(look: ReelLook) -> Iterator[np.ndarray]:
    """Yield the pictures of the title."""
    count = round(look.title_s * look.fps)
    fade = max(1, round(FADE_S * look.fps))
    if not count:
        return
    frame = Image.fromarray(_blank(look.height, look.width))
    draw, unit = ImageDraw.Draw(frame), look.height / 540
    middle = (look.width / 2, look.height / 2)
    draw.text(middle, look.title, font=font(round(64 * unit)), fill=TEXT_INK, anchor="ms")
    below = (middle[0], middle[1] + 40 * unit)
    draw.text(below, look.subtitle, font=font(round(22 * unit)), fill=TEXT_INK, anchor="ms")
    card = np.asarray(frame)
    for k in range(count):
        yield faded(card, min(1.0, (k + 1) / fade, (count - k) / fade))


def faded(picture: np.ndarray, seen: float) -> np.ndarray:
    """Return a picture of which only a share is seen before the empty studio."""
    if seen >= 1.0:
        return picture
    blank = _blank(*picture.shape[:2])
    return (blank + seen * (picture.astype(np.float32) - blank) + 0.5).astype(np.uint8)


def _blank(height: int, width: int) -> np.ndarray:
    return np.tile(np.round(255 * np.array(HORIZON)).astype(np.uint8), (height, width, 1))
