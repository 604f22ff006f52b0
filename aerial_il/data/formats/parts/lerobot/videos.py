"""Decode the pictures of a LeRobot dataset: of each camera, the part of a video that belongs to an episode."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from aerial_il.core.errors import DemoError, UnknownNameError
from aerial_il.core.lerobot_names import IMAGES
from aerial_il.core.specs import Field, image_name

MAX_PICTURES_BYTES = 400 << 20  # of one camera in one episode
MOST_SKIPPED = 5_000  # pictures between the key frame that a decoder begins with and an episode's first
CHANNELS = 3


@dataclass(frozen=True)
class Clip:
    """Where the pictures of one episode lie.

    Attributes:
        file: the video. start_s: time of the first picture in it. steps: how many. period_s: between two.
        shape: height, width and channels.
    """

    file: Path
    start_s: float
    steps: int
    period_s: float
    shape: tuple[int, ...]


def camera_fields(features: Mapping[str, Any]) -> tuple[Field, ...]:
    """Return a field ``<camera>_rgb`` (H, W, 3) for each feature that is a colour video; depth is left out."""
    found = []
    for key, feature in features.items():
        if feature.get("dtype") != "video" or _is_depth(feature):
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


def wanted_cameras(cameras: bool | Sequence[str], fields: Sequence[Field]) -> tuple[Field, ...]:
    """Return the fields that were asked for.

    Raises:
        UnknownNameError: the dataset has no such video.
    """
    if isinstance(cameras, bool):
        return tuple(fields) if cameras else ()
    by_name = {field.name: field for field in fields}
    for name in cameras:
        if name not in by_name:
            raise UnknownNameError("camera with a video", name, by_name, "Leave it out: policy.images=[]")
    return tuple(by_name[name] for name in cameras)


def clip_of(path: Path, info: Mapping[str, Any], row: Mapping[str, Any], field: Field) -> Clip:
    """Return where the pictures of an episode lie.

    Args:
        path: of the dataset. info: its ``info.json``. row: of the episode, from ``meta/episodes``. field: the camera.

    Raises:
        DemoError: the pictures would take too much memory. KeyError, ValueError: a place is missing.
    """
    (key,) = (key for key in info["features"] if field_name(key) == field.name)
    place = {name: int(row[f"videos/{key}/{name}"]) for name in ("chunk_index", "file_index")}
    relative = PurePosixPath(str(info["video_path"]).format(video_key=key, **place))
    file, steps = path / relative, int(row["length"])
    if ".." in relative.parts or relative.is_absolute() or not file.resolve().is_relative_to(path.resolve()):
        raise DemoError(path, "refers to a place outside itself.", got=str(relative))
    if (size := steps * field.size) > MAX_PICTURES_BYTES:
        raise DemoError(file, "is too large.", expected=f"at most {MAX_PICTURES_BYTES} bytes", got=size)
    return Clip(file, float(row[f"videos/{key}/from_timestamp"]), steps, 1 / float(info["fps"]), field.shape)


def read_clip(clip: Clip) -> np.ndarray:
    """Return the pictures (steps + 1, H, W, 3) uint8; the last one stands in for the terminal one.

    Raises:
        DemoError: the video is missing, damaged, of another size, or lacks pictures.
    """
    from av.error import FFmpegError

    pictures, seen = np.zeros((clip.steps + 1, *clip.shape), np.uint8), np.zeros(clip.steps, bool)
    if not clip.file.is_file():
        raise DemoError(clip.file, "is missing.")
    try:
        for number, picture in _decoded(clip):
            pictures[number], seen[number] = picture, True
            if number == clip.steps - 1:
                break
    except (FFmpegError, IndexError, OSError) as error:
        raise DemoError(clip.file, f"cannot be decoded ({error}).") from error
    if not seen.all():
        raise DemoError(clip.file, "lacks pictures of an episode.", expected=clip.steps, got=int(seen.sum()))
    pictures[-1] = pictures[-2]
    return pictures


def _decoded(clip: Clip) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the pictures of a clip with their step."""
    import av

    with av.open(str(clip.file)) as video:
        stream = video.streams.video[0]
        found = (stream.codec_context.height, stream.codec_context.width, CHANNELS)
        if found != clip.shape or stream.time_base is None:
            raise DemoError(clip.file, "has pictures of another size.", expected=clip.shape, got=found)
        video.seek(max(0, round(clip.start_s / stream.time_base) - 1), backward=True, stream=stream)
        for count, frame in enumerate(video.decode(stream)):
            number = -1 if frame.time is None else round((frame.time - clip.start_s) / clip.period_s)
            if number >= clip.steps or count > clip.steps + MOST_SKIPPED:
                return
            if number >= 0 and (frame.height, frame.width) == clip.shape[:2]:
                yield number, frame.to_ndarray(format="rgb24")


def _is_depth(feature: Mapping[str, Any]) -> bool:
    told = feature.get("info") or feature.get("video_info") or {}
    return bool(isinstance(told, dict) and told.get("video.is_depth_map"))
