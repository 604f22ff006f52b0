"""Films of chosen episodes: each is flown again from its seed and recorded actions, bit for bit, and rendered.

A recording is rendered from its states, whoever flew it. H.264 in MP4 through PyAV, without a system ffmpeg. On a
machine that cannot render, there are no films and a sentence says why; everything else goes on.
"""

from __future__ import annotations

import io
import math
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import repeat, zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from aerial_il.core.contracts import BatchEnv, Observation, Policy, StepResult
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.files import write_atomic, writing
from aerial_il.core.places import MADE_BY
from aerial_il.core.progress import Progress
from aerial_il.data.episode import Episode
from aerial_il.data.provenance import DROPPED
from aerial_il.evaluation.failures import kind_of, kinds_of
from aerial_il.evaluation.metrics import End, EpisodeRecord, why_ended
from aerial_il.evaluation.result import EvaluationResult, Flight
from aerial_il.policies.parts.flying import FlyingPolicy
from aerial_il.presentation.films.overlay import Caption, compose
from aerial_il.presentation.films.scene_renderer import SceneRenderer
from aerial_il.presentation.pages.page import data_uri
from aerial_il.presentation.studio.studio import QUICK

if TYPE_CHECKING:
    from aerial_il.presentation.films.sight import Sight

FPS = 25
HOLD_S = 1.2  # the last frame stays this long, so that the outcome can be read
LONGEST_CLIP_S = 12.0  # longer episodes play faster
MAX_RATE = 500_000  # bit/s, which keeps the longest clip below 1 MB
JPEG_QUALITY = 85
VIEW_SIZE = (396, 528)  # height, width of one camera view
SEEN = "seen"  # what the view of a policy's own images is called


@dataclass(frozen=True)
class Clip:
    """A film on disk of one episode, beside it its last picture where it was made here."""

    path: Path
    episode: EpisodeRecord

    @property
    def poster(self) -> Path:
        return self.path.with_suffix(".jpg")

    @property
    def speed(self) -> int:
        """The number of times by which it plays faster than real time."""
        return math.ceil(self.episode.duration_s / LONGEST_CLIP_S)


@dataclass(frozen=True)
class Footage:
    """The films of an evaluation, or a sentence saying why there are none."""

    clips: tuple[Clip, ...] = ()
    note: str = ""


def embedded(clips: Sequence[Clip]) -> list[dict[str, Any]]:
    """Return what a page shows of films: ``clip``, ``episode``, the film as ``data`` and its ``poster``, if any."""
    return [
        {
            "clip": clip,
            "episode": clip.episode,
            "data": data_uri(clip.path),
            "poster": data_uri(clip.poster) if clip.poster.exists() else "",
        }
        for clip in clips
    ]


def film(
    env: BatchEnv,
    result: EvaluationResult,
    folder: str | os.PathLike[str],
    *,
    successes: int = 2,
    failures: int = 2,
    cameras: Sequence[str] = ("scene", "wrist"),
    policy: Policy | None = None,
    progress: bool = False,
) -> Footage:
    """Film the first successes, and of failures the first of each kind, the most frequent kind first.

    Args:
        env: a batch environment of the cell and tier of ``result``; its world 0 is used.
        result: an evaluation whose flights still hold their actions.
        folder: where the MP4 files go, named ``seed_<seed>_<end>.mp4``.
        successes, failures: how many of each, at most.
        cameras: views from left to right; those that the environment lacks are left out.
        policy: what flew; of one that looks at images, these are shown beside the scene, with what it makes of them.
        progress: show a progress bar for each film.

    Returns:
        The clips in the order of their seeds, or the reason why nothing can be rendered.
    """
    views = [name for name in cameras if name in env.camera_names]
    problem = rendering_problem(env, views)
    if problem:
        return Footage(note=f"No video: {problem}")
    won = [episode for episode in result.episodes if episode.success]
    chosen = won[:successes] + _failures(result)[:failures]
    clips = []
    for episode in sorted(chosen, key=lambda e: result.seeds.index(e.seed)):
        path = Path(folder) / f"seed_{episode.seed}_{episode.end}.mp4"
        sight = sight_of(policy)
        clips.append(film_episode(env, result, episode, path, cameras=views, sight=sight, progress=progress))
    return Footage(tuple(clips))


def rendering_problem(env: BatchEnv, cameras: Sequence[str]) -> str:
    """Return why ``env`` cannot be filmed, or an empty string. The reason comes from OpenGL itself, in its words."""
    if not cameras:
        return f"the environment has none of the cameras asked for; it has {', '.join(env.camera_names) or 'none'}."
    try:
        env.render(0, cameras[0], *VIEW_SIZE)
    except Exception as error:  # the renderer, its bindings and the driver each raise their own kind
        return f"this machine cannot render ({type(error).__name__}: {error}). `aerial-il doctor` says what is missing."
    return ""


def film_episode(
    env: BatchEnv, result: EvaluationResult, episode: EpisodeRecord, path: Path, *, cameras: Sequence[str],
    sight: Sight | None = None, progress: bool = False,
) -> Clip:  # fmt: skip
    """Fly one episode again in world 0 of ``env`` and write its film.

    Raises:
        InvalidValueError: the actions of the episode were not kept (results read from disk have none).
    """
    flight = result.flights.get(episode.seed)
    if flight is None or flight.actions is None:
        raise InvalidValueError(f"The actions of seed {episode.seed} were not kept; evaluate it again to film it.")
    clip = Clip(path, episode)
    dt, speed = env.spec.control_dt_s, clip.speed
    stride, rate = rate_of(dt, FPS)
    title = " · ".join((result.task, result.robot, result.tier, f"seed {episode.seed}"))
    title += f" · {speed}x" if speed > 1 else ""
    moments = _moments(env, episode, flight, title=title, stride=speed * stride, sight=sight)
    if env.engine is None:
        frames = (compose({name: env.render(0, name, *VIEW_SIZE) for name in cameras}, said) for said in moments)
    else:
        seen = [(said, env.get_state()[0], sight and sight.picture(VIEW_SIZE[0])) for said in moments]
        frames = _in_the_studio(env.model_xml, seen, cameras[:1] if sight else cameras)
    steps, name = range(len(flight.actions))[:: speed * stride], f"film of seed {episode.seed}"
    total = len(steps) + (steps[-1] != len(flight.actions) - 1)  # the last moment is always shown
    drawn = Progress(frames, total=total, desc=name, unit="frame", disable=not progress)
    last = write_mp4(path, iter(drawn), rate=rate, hold_frames=round(HOLD_S * rate))
    write_atomic(clip.poster, jpeg(last))
    return clip


def _moments(
    env: BatchEnv, episode: EpisodeRecord, flight: Flight, *, title: str, stride: int, sight: Sight | None
) -> Iterator[Caption]:
    """Fly again, look on, and yield what there is to say whenever a picture is due."""
    assert flight.actions is not None
    length, done = len(flight.actions), np.zeros(len(env.spec.subtasks), dtype=bool)
    look = None if sight is None else sight.look
    for step, result in enumerate(fly_again(env, episode.seed, flight.actions, begins=look)):
        done |= result.info["subtasks"][0]
        if look is not None:
            look(result.obs)
        last = step == length - 1
        if step % stride and not last:
            continue
        yield Caption(
            title=title,
            time_s=(step + 1) * env.spec.control_dt_s,
            progress=(step + 1) / length,
            phase=_phase_name(flight, step),
            subtasks=dict(zip(env.spec.subtasks, done.tolist(), strict=True)),
            end=episode.end if last else "",
        )


def _in_the_studio(
    model_xml: str,
    moments: Sequence[tuple[Caption, np.ndarray, np.ndarray | None]],
    cameras: Sequence[str],
    bar: Progress | None = None,
) -> Iterator[np.ndarray]:
    """Draw captions and states (S,) as people see them, from where the flight fills the picture for ``scene``.

    Beside them stands what the robot sees, where there is a picture of it.
    """
    with SceneRenderer(model_xml) as scene:
        whole = scene.frame([state for _, state, _ in moments], VIEW_SIZE[1] / VIEW_SIZE[0])
        names = [name for name in cameras if name == "scene" or name in scene.cameras][:2]
        views = {"flight" if name == "scene" else name: whole if name == "scene" else name for name in names}
        for caption, state, seen in moments:
            pictures = {name: scene.draw(state, view, *VIEW_SIZE, exposures=QUICK) for name, view in views.items()}
            pictures |= {} if seen is None else {SEEN: seen}
            yield compose(pictures, caption)
            if bar is not None:
                bar.update()


def sight_of(policy: Policy | None) -> Sight | None:
    """Return what shows the images that a policy looks at, or None where it looks at none."""
    if not (isinstance(policy, FlyingPolicy) and policy.interface.layout.images):
        return None
    from aerial_il.presentation.films.sight import Sight

    return Sight(policy)


def fly_again(
    env: BatchEnv, seed: int, actions: np.ndarray, *, begins: Callable[[Observation], None] | None = None
) -> Iterator[StepResult]:
    """Step world 0 through recorded actions (T, Da) from its seed; yield what comes of each.

    Args:
        begins: called with what it shows before the first.
    """
    only_first = np.arange(env.num_envs) == 0
    obs = env.reset(np.full(env.num_envs, seed), only_first)
    if begins is not None:
        begins(obs)
    batch = np.tile(actions[0], (env.num_envs, 1))
    for action in actions:
        batch[0] = action
        yield env.step(batch, only_first)


def film_recording(
    episode: Episode,
    path: Path,
    *,
    steps: range | None = None,
    flags: np.ndarray | None = None,
    progress: bool = False,
) -> Path:
    """Write the film of a recorded flight in real time, from its states: as a whole, and what the robot sees.

    Args:
        episode: the recording. path: MP4 file. steps: consecutive ones that are shown; None for all.
        flags: (T, K) sub-tasks after each step, if they are known.
        progress: show a progress bar.
    """
    stride, rate = rate_of(episode.spec.control_dt_s, FPS)
    shown = range(len(episode)) if steps is None else steps
    due = [*shown[::stride], shown.stop]
    moments = [(caption_of(episode, step, flags), episode.states[step], None) for step in due]
    with Progress(total=len(due), desc="film", unit="frame", disable=not progress) as bar:
        frames = _in_the_studio(episode.model_xml, moments, ("scene", "wrist", "base"), bar)
        write_mp4(path, frames, rate=rate, hold_frames=round(HOLD_S * rate))
    return path


def rate_of(dt: float, fps: float) -> tuple[int, Fraction]:
    """Return every which step of ``dt`` s is shown at about ``fps``, and how many pictures a second that is."""
    stride = max(1, round(1 / (dt * fps)))
    return stride, Fraction(1 / (dt * stride)).limit_denominator(1000)


def caption_of(episode: Episode, step: int, flags: np.ndarray | None = None) -> Caption:
    """Return what there is to say of a recorded flight after ``step`` steps; ``flags`` (T, K): of its sub-tasks."""
    spec = episode.spec
    return Caption(
        title=" · ".join((spec.task, spec.robot, spec.tier, f"seed {episode.provenance.get('seed', '?')}")),
        time_s=float(episode.sim_time[step] - episode.sim_time[0]),
        progress=step / len(episode),
        phase=phase_at(episode, min(step, len(episode) - 1)),
        subtasks={} if flags is None else {name: bool(flags[:step, k].any()) for k, name in enumerate(spec.subtasks)},
        end=end_of(episode) if step == len(episode) else "",
    )


def end_of(episode: Episode) -> End:
    """Return how a recorded flight ended."""
    dropped = episode.provenance.get("note") == DROPPED
    return why_ended(success=episode.success, crash=bool(episode.terminated[-1]) and not dropped, dropped=dropped)


def phase_at(episode: Episode, step: int) -> str:
    """Return the name of the phase in a step of a recorded flight, or an empty string."""
    names, phase = episode.provenance.get("phases", ()), int(episode.phase[step])
    return names[phase] if 0 <= phase < len(names) else ""


def write_mp4(
    path: Path, frames: Iterator[np.ndarray], *, rate: Fraction, hold_frames: int = 0, max_rate: int = MAX_RATE
) -> np.ndarray:
    """Encode (H, W, 3) uint8 frames of even size as H.264 that browsers play, whole or not at all.

    Args:
        path: destination; missing parent folders are made.
        frames: the pictures.
        rate: frames per second.
        hold_frames: how often the last picture is shown again.
        max_rate: bit/s.

    Returns:
        The last picture.
    """
    import av

    picture = np.zeros((0, 0, 3), np.uint8)

    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.part")
    options = {"crf": "26", "preset": "medium", "maxrate": str(max_rate), "bufsize": str(max_rate)}
    with writing(path, part):
        with av.open(str(part), "w", format="mp4", options={"movflags": "+faststart"}) as container:
            container.metadata["comment"] = MADE_BY
            stream = container.add_stream("libx264", rate=rate, options=options)
            stream.pix_fmt = "yuv420p"
            for picture in _held(frames, hold_frames):
                stream.height, stream.width = picture.shape[:2]
                container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
            container.mux(stream.encode(None))
        os.replace(part, path)
    return picture


def jpeg(picture: np.ndarray, quality: int = JPEG_QUALITY) -> bytes:
    """Return an (H, W, 3) uint8 picture as a JPEG file."""
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "JPEG", quality=quality, optimize=True)
    return buffer.getvalue()


def png(picture: np.ndarray) -> bytes:
    """Return an (H, W, 3) uint8 picture as a PNG file."""
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "PNG", optimize=True, pnginfo=signed_png())
    return buffer.getvalue()


def signed_png() -> PngInfo:
    """Return what a PNG says of who made it."""
    info = PngInfo()
    info.add_text("Software", MADE_BY)
    return info


def _held(frames: Iterator[np.ndarray], times: int) -> Iterator[np.ndarray]:
    last = None
    for last in frames:
        yield last
    if last is not None:
        yield from repeat(last, times)


def _phase_name(flight: Flight, step: int) -> str:
    if flight.phase is None or not flight.phase_names or flight.phase[step] < 0:
        return ""
    return flight.phase_names[flight.phase[step]]


def _failures(result: EvaluationResult) -> list[EpisodeRecord]:
    """Return the failed episodes: the first of each kind, the most frequent kind first, then the second of each, ..."""
    kinds = {kind: [e for e in result.episodes if kind_of(e) == kind] for kind in kinds_of(result.episodes)}
    rounds = zip_longest(*kinds.values())
    return [episode for each in rounds for episode in each if episode is not None]
