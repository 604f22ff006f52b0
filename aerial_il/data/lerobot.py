"""Derive a LeRobot v3 dataset from recordings, so that lerobot opens and trains on it without glue.

============================  ======================================================================
feature                       content
============================  ======================================================================
observation.state             all proprioceptive fields, concatenated, named element by element
observation.environment_state all fields of the task, likewise
observation.images.<camera>   one video per colour camera
action                        the expert's label where there is one, else the executed action
next.reward, next.done        of the step; done marks the last one
next.success                  true on the last step of a success
demo.uid                      key to ``meta/provenance.json``; survives delete and merge
============================  ======================================================================

Frames are the T observations that an action follows; the terminal one is left out. The dataset is built in a temporary
folder from whole recordings and renamed when it is complete, as lerobot cannot read an unfinished one.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from aerial_il.core.errors import DemoError, UnknownNameError
from aerial_il.core.files import sync_folder, write_json
from aerial_il.core.lerobot_names import ACTION, ENVIRONMENT, IMAGES, STATE
from aerial_il.core.specs import EnvSpec, Field
from aerial_il.data.dataset import open_dataset
from aerial_il.data.episode import Episode
from aerial_il.data.writer import storing

PROVENANCE = "meta/provenance.json"
DEFAULT_OUT = "derived/lerobot"


def convert_to_lerobot(
    path: str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    *,
    cameras: Sequence[str] | bool = True,
    progress: bool = True,
) -> Path:
    """Convert the successes of a dataset of recordings.

    Args:
        path: a folder of recordings.
        out: where the LeRobot dataset goes, ``<path>/derived/lerobot`` if not given; an older one is replaced.
        cameras: True for all recorded image fields as videos, False for states alone, or the names of some.
        progress: show a progress bar.

    Returns:
        The folder.

    Raises:
        DemoError: a recording cannot be read.
        UnknownNameError: a camera was not recorded.
        StorageError: the disk is full; an older conversion is untouched.
    """
    spec = open_dataset(path).spec
    names = _camera_names(spec, cameras)
    dataset = open_dataset(path, cameras=names)
    out = Path(out) if out else Path(path) / DEFAULT_OUT
    temporary = out.with_name(f".{out.name}.{os.getpid()}.tmp")
    shutil.rmtree(temporary, ignore_errors=True)
    try:
        with storing(out):
            out.parent.mkdir(parents=True, exist_ok=True)
            _build(temporary, spec, names, tqdm(dataset, desc="convert", unit="ep", disable=not progress))
            _replace(temporary, out)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return out


def _build(root: Path, spec: EnvSpec, cameras: Sequence[str], episodes: Iterable[Episode]) -> None:
    """Write a complete dataset to ``root``."""
    os.environ.setdefault("HF_HUB_OFFLINE", "1")
    os.environ.setdefault("SVT_LOG", "1")  # the video encoder reports errors only
    from datasets.utils.logging import disable_progress_bar
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    disable_progress_bar()  # one bar for each episode
    dataset = LeRobotDataset.create(
        f"local/{spec.robot}-{spec.task}",
        fps=round(1 / spec.control_dt_s),
        features=features_of(spec, cameras),
        root=root,
        robot_type=spec.robot,
        use_videos=bool(cameras),
        video_backend="pyav",  # torchcodec needs a system FFmpeg
        streaming_encoding=bool(cameras),
        encoder_queue_maxsize=spec.max_steps + 1,  # a full queue drops frames
    )
    origins = []
    try:
        for episode in episodes:
            for frame in frames_of(episode, cameras):
                dataset.add_frame(frame)
            dataset.save_episode()
            origins.append({"uid": episode.uid, "success": episode.success, "provenance": dict(episode.provenance)})
    finally:
        dataset.finalize()  # else it would write on when it is collected as garbage
    _check_videos(root, dataset.meta.total_frames)
    files = {str(f.relative_to(root)): f.stat().st_size for f in sorted(root.rglob("*")) if f.is_file()}
    write_json(root / PROVENANCE, {"schema": 1, "spec": spec.to_dict(), "episodes": origins, "files": files})


def _check_videos(root: Path, frames: int) -> None:
    """Require that no encoder has dropped a frame."""
    import av

    for folder in sorted((root / "videos").glob("*")):
        found = 0
        for file in sorted(folder.rglob("*.mp4")):
            with av.open(str(file)) as video:
                found += sum(packet.size > 0 for packet in video.demux(video=0))
        if found != frames:
            raise DemoError(folder, "was encoded with another number of frames.", expected=frames, got=found)


def features_of(spec: EnvSpec, cameras: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return lerobot's description of the columns."""
    features = {
        STATE: _vector(spec.observation.of_group("proprio")),
        ENVIRONMENT: _vector(spec.observation.of_group("task")),
        ACTION: {"dtype": "float64", "shape": (spec.action.size,), "names": list(spec.action.labels)},
        "next.reward": {"dtype": "float64", "shape": (1,), "names": None},
        "next.done": {"dtype": "bool", "shape": (1,), "names": None},
        "next.success": {"dtype": "bool", "shape": (1,), "names": None},
        "demo.uid": {"dtype": "string", "shape": (1,), "names": None},
    }
    for name in cameras:
        shape = spec.observation[name].shape
        features[image_key(name)] = {"dtype": "video", "shape": shape, "names": ["height", "width", "channels"]}
    return {name: feature for name, feature in features.items() if 0 not in feature["shape"]}


def frames_of(episode: Episode, cameras: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Yield the T frames of an episode as lerobot wants them."""
    spec = episode.spec.observation
    vectors = {
        key: episode.flat_obs(tuple(f.name for f in fields))
        for key, fields in ((STATE, spec.of_group("proprio")), (ENVIRONMENT, spec.of_group("task")))
        if fields
    }
    labels = episode.labels
    for t in range(len(episode)):
        done = t == len(episode) - 1
        yield {
            **{key: values[t].copy() for key, values in vectors.items()},
            **{image_key(name): episode.obs[name][t].copy() for name in cameras},
            ACTION: labels[t].copy(),
            "next.reward": episode.rewards[t : t + 1].copy(),
            "next.done": np.array([done]),
            "next.success": np.array([done and episode.success]),
            "demo.uid": episode.uid,
            "task": episode.spec.instruction,
        }


def image_key(field: str) -> str:
    """Return the feature that holds a colour camera's field, e.g. ``observation.images.wrist`` for ``wrist_rgb``."""
    return IMAGES + field.removesuffix("_rgb")


def _vector(fields: Sequence[Field]) -> dict[str, Any]:
    labels = [label for field in fields for label in field.element_labels()]
    return {"dtype": "float64", "shape": (len(labels),), "names": labels}


def _camera_names(spec: EnvSpec, cameras: Sequence[str] | bool) -> tuple[str, ...]:
    recorded = tuple(f.name for f in spec.observation.of_group("image") if f.name.endswith("_rgb"))
    if isinstance(cameras, bool):
        return recorded if cameras else ()
    for name in cameras:
        if name not in recorded:
            raise UnknownNameError("recorded camera", name, recorded, "Record it with: aerial-il collect cameras=[...]")
    return tuple(cameras)


def _replace(new: Path, path: Path) -> None:
    """Put ``new`` in the place of ``path``."""
    old = path.with_name(f".{path.name}.{os.getpid()}.old")
    if path.exists():
        os.replace(path, old)
    os.replace(new, path)
    sync_folder(path.parent)
    shutil.rmtree(old, ignore_errors=True)
