"""Decode the pictures of a LeRobot dataset: of each camera, those that a video shows at an episode's time stamps."""

import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from aerial_il.core.errors import DemoError
from aerial_il.core.lerobot_names import IMAGES
from aerial_il.core.specs import Field, image_name

MOST_SKIPPED = 5_000  # pictures between the key frame that a decoder begins with and an episode's first
MOST_A_STEP = 20  # pictures between two time stamps
NEAR = 0.75  # of a control period: further from a time stamp a picture is none of it
CHANNELS = 3


@dataclass(frozen=True)
class Clip:
    """Where the pictures of one episode lie.

    Attributes:
        file: the video. times_s: (T,) when each was taken, in the time of the video. period_s: between two.
        shape: height, width and channels.
    """

    file: Path
    times_s: np.ndarray
    period_s: float
    shape: tuple[int, ...]


def camera_fields(features: Mapping[str, Any]) -> tuple[Field, ...]:
    """Return a field ``<camera>_rgb`` (H, W, 3) for each feature of colour videos or stills; depth is left out."""
    found = []
    for key, feature in features.items():
        if feature.get("dtype") not in ("video", "image") or _is_depth(feature):
            continue
        shape, names = tuple(map(int, feature["shape"])), list(feature.get("names") or ())
        if names and str(names[0]).startswith("channel"):
            shape = (*shape[1:], shape[0])
        if len(shape) == 3 and shape[2] == CHANNELS and min(shape) > 0:
            found.append(Field(field_name(key), shape, "image", "uint8"))
    return tuple(found)


def field_name(key: str) -> str:
    """Return the field that holds a camera, ``wrist_rgb`` for ``observation.images.wrist``."""
    return image_name(key.removeprefix(IMAGES).removeprefix("observation."))


def clip_of(
    path: Path, info: Mapping[str, Any], row: Mapping[str, Any], key: str, field: Field, times_s: np.ndarray
) -> Clip:
    """Return where the pictures of an episode lie.

    Args:
        path: of the dataset. info: its ``info.json``. row: of the episode, from ``meta/episodes``.
        key, field: of the camera. times_s: (T,) of its rows, since the episode began.

    Raises:
        DemoError: outside the dataset. KeyError, ValueError: a place is missing.
    """
    place = {name: int(row[f"videos/{key}/{name}"]) for name in ("chunk_index", "file_index")}
    relative = PurePosixPath(str(info["video_path"]).format(video_key=key, **place))
    file = path / relative
    if ".." in relative.parts or relative.is_absolute() or not file.resolve().is_relative_to(path.resolve()):
        raise DemoError(path, "refers to a place outside itself.", got=str(relative))
    start_s = float(row[f"videos/{key}/from_timestamp"])
    return Clip(file, start_s + times_s, 1 / float(info["fps"]), field.shape)


def read_clip(clip: Clip) -> np.ndarray:
    """Return the pictures (T, H, W, 3) uint8: of each time stamp the one nearest to it.

    Raises:
        DemoError: the video is missing, damaged, of another size, or lacks pictures.
    """
    from av.error import FFmpegError

    pictures, seen = np.zeros((len(clip.times_s), *clip.shape), np.uint8), np.zeros(len(clip.times_s), bool)
    if not clip.file.is_file():
        raise DemoError(clip.file, "is missing.")
    order = np.argsort(clip.times_s, kind="stable")
    try:
        for place, picture in _nearest(clip, clip.times_s[order]):
            pictures[order[place]], seen[order[place]] = picture, True
    except (FFmpegError, IndexError, OSError) as error:
        raise DemoError(clip.file, f"cannot be decoded ({error}).") from error
    if not seen.all():
        raise DemoError(clip.file, "lacks pictures of an episode.", expected=len(seen), got=int(seen.sum()))
    return pictures


def _nearest(clip: Clip, times_s: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the place of each of the times, which ascend, with the picture nearest to it, if it is near enough."""
    place, before = 0, None
    for frame in chain(_decoded(clip, times_s), [None]):
        while before is not None and place < len(times_s):
            if frame is not None and times_s[place] > (before.time + frame.time) / 2:
                break
            if abs(before.time - times_s[place]) <= NEAR * clip.period_s:
                yield place, before.to_ndarray(format="rgb24")
            place += 1
        before = frame


def _decoded(clip: Clip, times_s: np.ndarray) -> Iterator[Any]:
    """Yield the frames of a video from the first of the times on, up to one after the last."""
    import av

    with av.open(str(clip.file)) as video:
        stream = video.streams.video[0]
        found = (stream.codec_context.height, stream.codec_context.width, CHANNELS)
        if found != clip.shape or stream.time_base is None:
            raise DemoError(clip.file, "has pictures of another size.", expected=clip.shape, got=found)
        video.seek(max(0, round(times_s[0] / stream.time_base) - 1), backward=True, stream=stream)
        after = 0
        for count, frame in enumerate(video.decode(stream)):
            if count > MOST_SKIPPED + MOST_A_STEP * len(times_s):
                return
            if frame.time is not None and (frame.height, frame.width) == clip.shape[:2]:
                yield frame
                after += frame.time > times_s[-1]
            if after:
                return


def read_stills(path: Path, files: Sequence[Path], key: str, episode: int, shape: tuple[int, ...]) -> np.ndarray:
    """Return the pictures (T, H, W, 3) uint8 that Parquet files hold, encoded, in a column.

    Raises:
        DemoError: one cannot be decoded, or is of another size.
    """
    import pyarrow.dataset as arrow
    from PIL import Image

    rows = arrow.dataset([str(file) for file in files]).to_table([key], filter=arrow.field("episode_index") == episode)
    pictures = np.zeros((len(rows), *shape), np.uint8)
    for step, held in enumerate(rows[key].to_pylist()):
        try:
            still = Image.open(io.BytesIO(held["bytes"]), formats=("PNG", "JPEG"))
            if (found := (still.height, still.width)) != shape[:2]:
                raise DemoError(path, "has a picture of another size.", step=step, field=key, expected=shape, got=found)
            pictures[step] = np.asarray(still.convert("RGB"))
        except (OSError, SyntaxError, TypeError, KeyError, Image.DecompressionBombError) as error:
            raise DemoError(path, f"has a picture that cannot be decoded ({error}).", step=step, field=key) from error
    return pictures


def _is_depth(feature: Mapping[str, Any]) -> bool:
    told = feature.get("info") or feature.get("video_info") or {}
    return bool(isinstance(told, dict) and told.get("video.is_depth_map"))
