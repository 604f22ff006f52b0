"""Small files as other tools record them, written as their own scripts do; each test says what is odd about its own."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

RATE = 30


def last(steps: int) -> np.ndarray:
    """(T,) 1 at the last step."""
    return (np.arange(steps) == steps - 1).astype(int)


def demo(steps: int, mark: float, **changes: Any) -> dict[str, Any]:
    """Return a demonstration whose observations and actions tell it and the step: ``mark + .01 t``."""
    line = mark + 0.01 * np.arange(steps)[:, None]
    made = {
        "actions": np.repeat(line, 2, 1),
        "rewards": last(steps).astype(float),
        "dones": last(steps),
        "states": np.repeat(line, 5, 1),
        "obs": {"pos": np.repeat(line, 3, 1)},
    }
    return {name: values for name, values in (made | changes).items() if values is not None}


def buffered(steps: int, mark: float, **changes: Any) -> dict[str, Any]:
    """Return an episode of Minari's, which its time limit ends."""
    line = mark + 0.01 * np.arange(steps + 1)[:, None]
    none = np.zeros(steps, bool)
    made = {"observations": np.repeat(line, 3, 1), "actions": np.repeat(line[:-1], 2, 1), "rewards": np.ones(steps)}
    made |= {"terminations": none, "truncations": last(steps).astype(bool)}
    return made | changes


def lerobot(
    path: Path,
    lengths: Sequence[int],
    *,
    extra: Mapping[str, tuple[str, Sequence[int], Callable]] | None = None,
    rows: Sequence[int] | None = None,
    times: Callable[[np.ndarray], np.ndarray] | None = None,
    change: Callable[[dict[str, Any]], None] | None = None,
    info: Mapping[str, Any] | None = None,
    cameras: Mapping[str, tuple[int, int]] | None = None,
    video_rate: int = RATE,
) -> Path:
    """Write a LeRobot v3 folder: state = (100 e + t, 1), action = 100 e + t + .5; grey pictures that tell the time.

    Args:
        extra: feature -> its type, shape, and (frame, length) -> its rows. rows: the order in which they are written.
        times: of the time stamps. change: of the columns. info: further keys of ``info.json``.
        cameras: name -> height and width of a video; their pictures come ``video_rate`` times a second.
    """
    episode = np.repeat(np.arange(len(lengths)), lengths)
    frame = np.concatenate([np.arange(n) for n in lengths])
    columns: dict[str, Any] = {
        "observation.state": np.stack([100.0 * episode + frame, np.ones(len(frame))], 1),
        "action": (100.0 * episode + frame + 0.5)[:, None],
        "timestamp": times(frame / RATE) if times else frame / RATE,
        "frame_index": frame,
        "episode_index": episode,
        "index": np.arange(len(frame)),
        "task_index": np.zeros(len(frame), int),
    }
    features = {"observation.state": ("float32", [2]), "action": ("float32", [1]), "timestamp": ("float32", [1])}
    features |= {name: ("int64", [1]) for name in ("frame_index", "episode_index", "index", "task_index")}
    for name, (kind, shape, values) in (extra or {}).items():
        columns[name] = values(frame, np.asarray(lengths)[episode])
        features[name] = (kind, list(shape))
    if change:
        change(columns)
    arrays = {name: pa.array(list(values) if np.ndim(values) > 1 else values) for name, values in columns.items()}
    table = pa.table(arrays)
    (path / "data/chunk-000").mkdir(parents=True)
    (path / "meta/episodes/chunk-000").mkdir(parents=True)
    pq.write_table(table if rows is None else table.take(pa.array(rows)), path / "data/chunk-000/file-000.parquet")
    ends, zeros = np.cumsum(lengths), [0] * len(lengths)
    places = {"data/chunk_index": zeros, "data/file_index": zeros}
    told = {"episode_index": [*range(len(lengths))], "length": [*lengths], "tasks": [["move"]] * len(lengths), **places}
    told |= {"dataset_from_index": (ends - lengths).tolist(), "dataset_to_index": ends.tolist()}
    pq.write_table(pa.table({"task_index": [0], "task": ["move"]}), path / "meta/tasks.parquet")
    video_path = None
    for name, size in (cameras or {}).items():
        video_path = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
        key, rate = f"observation.images.{name}", (info or {}).get("fps", RATE)
        features[key] = ("video", [*size, 3])
        film(path / video_path.format(video_key=key, chunk_index=0, file_index=0), len(frame) / rate, size, video_rate)
        told |= {f"videos/{key}/chunk_index": zeros, f"videos/{key}/file_index": zeros}
        told |= {f"videos/{key}/from_timestamp": ((ends - lengths) / rate).tolist()}
    pq.write_table(pa.table(told), path / "meta/episodes/chunk-000/file-000.parquet")
    described = {name: {"dtype": kind, "shape": shape, "names": None} for name, (kind, shape) in features.items()}
    written = {
        "codebase_version": "v3.0", "robot_type": "arm", "fps": RATE, "total_episodes": len(lengths),
        "total_frames": len(frame), "splits": {"train": f"0:{len(lengths)}"}, "features": described,
        "video_path": video_path, "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
    }  # fmt: skip
    (path / "meta/info.json").write_text(json.dumps({**written, **(info or {})}))
    return path


def film(path: Path, seconds: float, size: tuple[int, int], rate: int) -> None:
    """Write a video whose pictures are as grey as :func:`grey` says of their time."""
    import av

    path.parent.mkdir(parents=True)
    with av.open(str(path), "w") as video:
        stream = video.add_stream("libx264", rate=rate, options={"crf": "10", "preset": "ultrafast"})
        stream.height, stream.width = size
        for number in range(round(seconds * rate)):
            shown = np.full((*size, 3), grey(number / rate), np.uint8)
            video.mux(stream.encode(av.VideoFrame.from_ndarray(shown, format="rgb24")))
        video.mux(stream.encode())


def grey(time_s: float) -> int:
    """Return how grey a picture is that was taken at a time of the video."""
    return 20 + round(120 * time_s) % 200


def pair(episodes: int, steps: int) -> dict[str, np.ndarray]:
    """Return what was seen before and after each action of episodes that lie apart, one after the other."""
    paths = [10.0 * k + np.arange(steps + 1)[:, None] * [0.1, 0.1] for k in range(episodes)]
    ends = {"obs": slice(None, -1), "next_obs": slice(1, None)}
    return {name: np.concatenate([path[part] for path in paths]) for name, part in ends.items()}
