"""Derive a LeRobot v3 dataset from episodes, so that lerobot opens and trains on it without glue.

=============================  ======================================================================
feature                        content
=============================  ======================================================================
observation.state              all proprioceptive fields, concatenated, named element by element
observation.environment_state  all fields of the task, likewise
observation.images.<camera>    one video per colour camera
action                         the expert's label where there is one, else the executed action
next.reward, next.done         of the step; done marks the last one
next.success                   true on the last step of a success
demo.uid                       key to ``meta/provenance.json``; its ``names`` tell the specification;
                               survives delete, split and merge
=============================  ======================================================================

Frames are the T observations that an action follows; the terminal one is left out. The dataset is built in a temporary
folder from whole recordings and renamed when it is complete, as lerobot cannot read an unfinished one.
"""

import fcntl
import glob
import hashlib
import os
import shutil
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from aerial_il.core.errors import DemoError
from aerial_il.core.files import sha256_of, write_json
from aerial_il.core.lerobot_names import ACTION, ENVIRONMENT, IMAGES, STATE
from aerial_il.core.specs import EnvSpec, Field, camera_name
from aerial_il.data.episode import Episode
from aerial_il.data.formats.parts.content_digest import sealed
from aerial_il.data.formats.parts.lerobot.identity import UID, identity
from aerial_il.data.formats.parts.lerobot.states import PROVENANCE, StateWriter
from aerial_il.data.formats.parts.whole import put_in_place
from aerial_il.data.recording.writer import storing

NEW, OLD = "new", "old"  # in the temporary folder


def write(episodes: Iterable[Episode], out: Path) -> Path:
    """Write episodes of one environment as a dataset, which replaces one that is there unless it fails.

    Cameras of which the first episode has pictures become videos.

    Raises:
        StorageError: the disk is full or the folder not writable.
    """
    with storing(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        _clear_leftovers(out)
        with _temporary(out) as temporary:
            _build(temporary, episodes)
            put_in_place(temporary, out, temporary.with_name(OLD))
    return out


@contextmanager
def _temporary(out: Path) -> Iterator[Path]:
    """Name a new folder beside ``out`` and remove what is left of it; it is locked as long as the process lives."""
    holder = out.with_name(f".{out.name}.{os.getpid()}.tmp")
    holder.mkdir()
    handle = os.open(holder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield holder / NEW
    finally:
        shutil.rmtree(holder, ignore_errors=True)
        os.close(handle)


def _clear_leftovers(out: Path) -> None:
    """Remove what killed conversions have left beside ``out``; the older dataset comes back if none replaced it."""
    for holder in out.parent.glob(f".{glob.escape(out.name)}.*.tmp"):
        handle = os.open(holder, os.O_RDONLY)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if (holder / OLD).exists() and not out.exists():
                os.replace(holder / OLD, out)
            shutil.rmtree(holder, ignore_errors=True)
        except BlockingIOError:  # its process lives
            continue
        finally:
            os.close(handle)


def _build(root: Path, episodes: Iterable[Episode]) -> None:
    """Write a complete dataset to ``root``."""
    os.environ.setdefault("HF_HUB_OFFLINE", "1")
    episodes, origins = iter(episodes), []
    first = next(episodes)
    spec, cameras = first.spec, [name for name in colour_cameras(first.spec) if name in first.obs]

    def noted() -> Iterator[Episode]:
        for episode in chain([first], episodes):
            yield episode
            origins.append({"uid": episode.uid, "success": episode.success, "provenance": dict(episode.provenance)})

    if cameras:
        write_with_lerobot(root, spec, cameras, noted())
    else:
        write_states(root, spec, noted())
    files = sorted(f for f in root.rglob("*") if f.is_file())
    entries = {str(f.relative_to(root)): {"bytes": f.stat().st_size, "sha256": sha256_of(f)} for f in files}
    tree = {"schema": 2, "spec": spec.to_dict(), "episodes": origins, "files": entries}
    write_json(root / PROVENANCE, {**tree, "seal": hashlib.sha256(sealed(tree)).hexdigest()})


def write_states(root: Path, spec: EnvSpec, episodes: Iterable[Episode]) -> None:
    """Write episodes without images to ``root``; equal to what :func:`write_with_lerobot` writes."""
    dataset = StateWriter(root, **_described(spec), features=features_of(spec, ()))
    try:
        for episode in episodes:
            dataset.add(columns_of(episode), episode.instruction)
    finally:
        dataset.close()


def write_with_lerobot(root: Path, spec: EnvSpec, cameras: Sequence[str], episodes: Iterable[Episode]) -> None:
    """Write episodes to ``root`` with lerobot's own writer, which encodes videos."""
    os.environ.setdefault("SVT_LOG", "1")  # the video encoder reports errors only
    from datasets.utils.logging import disable_progress_bar
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    disable_progress_bar()  # one bar for each episode
    dataset = LeRobotDataset.create(
        **_described(spec),
        features=features_of(spec, cameras),
        root=root,
        use_videos=bool(cameras),
        video_backend="pyav",  # torchcodec needs a system FFmpeg
        streaming_encoding=bool(cameras),
        encoder_queue_maxsize=spec.max_steps + 1,  # a full queue drops frames
    )
    try:
        for episode in episodes:
            for frame in frames_of(episode, cameras):
                dataset.add_frame(frame)
            dataset.save_episode()
    finally:
        dataset.finalize()  # else it would write on when it is collected as garbage
    _check_videos(root, dataset.meta.total_frames)


def _described(spec: EnvSpec) -> dict[str, Any]:
    name = f"local/{spec.robot}-{spec.task}"
    return {"repo_id": name, "fps": round(1 / spec.control_dt_s), "robot_type": spec.robot}


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
        UID: {"dtype": "string", "shape": (1,), "names": identity(spec)},
    }
    for name in cameras:
        shape = spec.observation[name].shape
        features[image_key(name)] = {"dtype": "video", "shape": shape, "names": ["height", "width", "channels"]}
    return {name: feature for name, feature in features.items() if 0 not in feature["shape"]}


def columns_of(episode: Episode) -> dict[str, np.ndarray]:
    """Return the T rows of an episode by feature: (T, D), or (T,) where a feature has one element."""
    spec, steps = episode.spec.observation, len(episode)
    vectors = {
        key: episode.flat_obs(tuple(f.name for f in fields))[:steps]
        for key, fields in ((STATE, spec.of_group("proprio")), (ENVIRONMENT, spec.of_group("task")))
        if fields
    }
    done = np.arange(steps) == steps - 1
    columns = {
        **vectors,
        ACTION: episode.labels,
        "next.reward": episode.rewards,
        "next.done": done,
        "next.success": done & episode.success,
        UID: np.full(steps, episode.uid),
    }
    return {name: values[:, 0] if values.shape[1:] == (1,) else values for name, values in columns.items()}


def frames_of(episode: Episode, cameras: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Yield the T frames of an episode as lerobot wants them."""
    columns = columns_of(episode)
    for t in range(len(episode)):
        yield {
            **{key: values[t] if key == UID else np.array(values[t], ndmin=1) for key, values in columns.items()},
            **{image_key(name): episode.obs[name][t].copy() for name in cameras},
            "task": episode.instruction,
        }


def image_key(field: str) -> str:
    """Return the feature that holds a colour camera's field, e.g. ``observation.images.wrist`` for ``wrist_rgb``."""
    return IMAGES + camera_name(field)


def _vector(fields: Sequence[Field]) -> dict[str, Any]:
    labels = [label for field in fields for label in field.element_labels()]
    return {"dtype": "float64", "shape": (len(labels),), "names": labels}


def colour_cameras(spec: EnvSpec) -> tuple[str, ...]:
    """Return the image fields that can become videos."""
    return tuple(f.name for f in spec.observation.fields if f.is_colour)
