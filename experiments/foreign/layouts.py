"""Files in the layouts that other tools document; LeRobot's by its own writer. Nothing here knows this package."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

LIFT = {"env_name": "Lift", "type": 1, "env_kwargs": {"control_freq": 20}}


def robomimic(
    path: Path,
    *demos: Mapping[str, Any],
    env: Mapping[str, Any] = LIFT,
    masks: Mapping[str, Sequence[str]] | None = None,
) -> Path:
    """Write robomimic's HDF5.

    Args:
        demos: each with its columns by name; those of ``obs`` and other groups in a mapping of their own.
        env: what it says of the environment. masks: name -> demonstrations of a part.
    """
    with h5py.File(path, "w") as file:
        data = file.create_group("data")
        data.attrs["env_args"] = json.dumps(env)
        data.attrs["total"] = sum(len(made.get("actions", ())) for made in demos)
        for i, made in enumerate(demos):
            group = data.create_group(f"demo_{i}")
            group.attrs["num_samples"] = len(made.get("actions", ()))
            for name, values in made.items():
                inner = values.items() if isinstance(values, Mapping) else [(None, values)]
                for key, array in inner:
                    group[f"{name}/{key}" if key else name] = array
        for name, listed in (masks or {}).items():
            file[f"mask/{name}"] = np.array(listed, "S")
    return path


def minari(path: Path, *episodes: Mapping[str, Any], env_spec: str | None = None) -> Path:
    """Write the folder that ``HDF5Storage`` of Minari 0.5 keeps.

    Args:
        episodes: each with its columns by name. env_spec: of the environment, as Gymnasium writes it.
    """
    (path / "data").mkdir(parents=True)
    with h5py.File(path / "data/main_data.hdf5", "w") as file:
        for number, made in enumerate(episodes):
            group = file.create_group(f"episode_{number}")
            group.attrs["total_steps"] = len(made.get("actions", ()))
            for name, values in made.items():
                group[name] = values
    told = {"data_format": "hdf5", **({"env_spec": env_spec} if env_spec else {})}
    (path / "data/metadata.json").write_text(json.dumps(told))
    return path


def d4rl(path: Path, columns: Mapping[str, np.ndarray]) -> Path:
    """Write D4RL's HDF5: transitions one after the other."""
    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            file[name] = values
    return path


def npz(path: Path, columns: Mapping[str, Any]) -> Path:
    """Write arrays as a script does."""
    np.savez(path, **columns)
    return path


def aloha(path: Path, *episodes: Mapping[str, np.ndarray]) -> Path:
    """Write the folder that ALOHA's ``record_episodes`` keeps, ``episode_<i>.hdf5`` for each demonstration."""
    path.mkdir(parents=True)
    for number, columns in enumerate(episodes):
        with h5py.File(path / f"episode_{number}.hdf5", "w") as file:
            file.attrs["sim"], file.attrs["compress"] = True, False
            for name, values in columns.items():
                file[name] = values
    return path


def lerobot(
    path: Path, *episodes: Mapping[str, np.ndarray], fps: int, robot_type: str, task: str, image_writer: str = "video"
) -> Path:
    """Write a LeRobot v3 folder by lerobot's own writer.

    Args:
        episodes: each with its columns ``observation.*`` and ``action``, pictures among them as (T, H, W, 3).
        fps: rows a second. robot_type, task: what it says of them. image_writer: ``video`` or ``image``.
    """
    os.environ |= {"HF_HUB_OFFLINE": "1", "HF_DATASETS_OFFLINE": "1", "SVT_LOG": "1"}
    from datasets.utils.logging import disable_progress_bar
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    disable_progress_bar()
    features = {
        name: {"dtype": image_writer, "shape": values.shape[1:], "names": ["height", "width", "channels"]}
        if values.ndim == 4
        else {"dtype": "float32", "shape": values.shape[1:], "names": None}
        for name, values in episodes[0].items()
    }
    pictured = any(values.ndim == 4 for values in episodes[0].values())
    made = LeRobotDataset.create(
        repo_id=f"local/{path.name}",
        fps=fps,
        features=features,
        root=path,
        robot_type=robot_type,
        use_videos=pictured and image_writer == "video",
        video_backend="pyav",  # torchcodec needs a system FFmpeg
    )
    for columns in episodes:
        for rows in zip(*columns.values(), strict=True):
            frame = dict(zip(columns, rows, strict=True))
            made.add_frame({**{n: v if v.ndim == 3 else v.astype(np.float32) for n, v in frame.items()}, "task": task})
        made.save_episode()
    made.finalize()
    return path
