"""Transitions one after the other: D4RL's HDF5, which is written too, and .npz as ``imitation`` and scripts keep it.

=============================  ================================  =======================================
what                           names that are understood
=============================  ================================  =======================================
observation before the action  observations, obs                 (N, Do)
action                         actions, acts                     (N, Da)
observation after it           next_observations, next_obs       optional
reward                         rewards, rews                     optional
the environment ended          terminals, dones, terminations    optional; an episode ends there
time was up                    timeouts, truncations             optional; likewise
=============================  ================================  =======================================

Source: J. Fu et al., "D4RL: Datasets for Deep Data-Driven Reinforcement Learning", 2020.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path

import h5py
import numpy as np

from aerial_il.core.bounded import read_npz
from aerial_il.core.errors import DemoError
from aerial_il.core.files import sync_folder
from aerial_il.data.episode import Episode
from aerial_il.data.formats.foreign import foreign_episode, foreign_spec
from aerial_il.data.recording.writer import storing

FIELD = "observation"  # what Gymnasium's environments with one vector are recorded with here
NAMES = {
    "obs": ("observations", "obs"),
    "actions": ("actions", "acts"),
    "next_obs": ("next_observations", "next_obs"),
    "rewards": ("rewards", "rews"),
    "terminals": ("terminals", "dones", "terminations"),
    "timeouts": ("timeouts", "truncations"),
}
NEEDED = ("obs", "actions")
Arrays = Mapping[str, np.ndarray]


def open_npz(path: Path) -> dict[str, Callable[[], Episode]]:
    """Return uid -> function that reads the episode from a file of transitions.

    Raises:
        DemoError: it is no such file, or asks for more memory than any.
    """
    try:
        raw = read_npz(path, [name for names in NAMES.values() for name in names])
    except (OSError, ValueError) as error:
        raise DemoError(path, f"cannot be read as transitions ({error}).") from error
    return episodes_of(path, raw)


def episodes_of(path: Path, raw: Arrays) -> dict[str, Callable[[], Episode]]:
    """Return uid -> function that makes the episode out of arrays by their own names.

    Raises:
        DemoError: what is needed is missing, of other lengths, or not finite.
    """
    arrays = _checked(path, {what: raw[name] for what, names in NAMES.items() for name in names if name in raw})
    obs, actions = arrays["obs"], arrays["actions"]
    steps = len(actions)
    terminals, timeouts = (arrays.get(name, np.zeros(steps)).astype(bool) for name in ("terminals", "timeouts"))
    ends = np.flatnonzero(terminals | timeouts) + 1
    ends = ends if len(ends) and ends[-1] == steps else np.append(ends, steps)
    starts = np.concatenate([[0], ends[:-1]])
    longest = int((ends - starts).max())
    spec = foreign_spec({FIELD: obs}, (actions.min(0), actions.max(0)), max_steps=longest)

    def episode(number: int) -> Episode:
        first, last = int(starts[number]), int(ends[number])
        after = arrays["next_obs"][last - 1 : last] if "next_obs" in arrays else obs[last - 1 : last]
        return foreign_episode(
            f"episode_{number:06d}",
            spec,
            obs={FIELD: np.concatenate([obs[first:last], after])},
            actions=actions[first:last],
            rewards=arrays["rewards"][first:last] if "rewards" in arrays else None,
            terminated=bool(terminals[last - 1]),
            truncated=bool(timeouts[last - 1] and not terminals[last - 1]),
            source=f"{path.name}, a file of transitions",
        )

    return {f"episode_{i:06d}": cache(lambda i=i: episode(i)) for i in range(len(starts))}


def convert_to_d4rl(episodes: Sequence[Episode], out: str | os.PathLike[str]) -> Path:
    """Write episodes of one environment as one flat file of D4RL's, which appears whole or not at all.

    An observation is all fields of numbers one after the other; their names and sizes stand in ``metadata/fields``.

    Raises:
        StorageError: the disk is full or the folder not writable.
    """
    out = Path(out)
    temporary = out.with_name(f".{out.name}.{os.getpid()}.tmp")
    names = episodes[0].spec.observation.state_names
    try:
        with storing(out):
            out.parent.mkdir(parents=True, exist_ok=True)
            with h5py.File(temporary, "w") as file:
                for name, values in _columns(episodes, names).items():
                    file[name] = values
                sizes = (f"{name}:{episodes[0].spec.observation[name].size}" for name in names)
                file["metadata/fields"] = " ".join(sizes)
            os.replace(temporary, out)
            sync_folder(out.parent)
    finally:
        temporary.unlink(missing_ok=True)
    return out


def _columns(episodes: Sequence[Episode], names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Return D4RL's arrays: what ended by success or failure is a terminal, all else a timeout."""
    flat = [episode.flat_obs(names) for episode in episodes]
    last = np.concatenate([np.arange(len(episode)) == len(episode) - 1 for episode in episodes])
    over = np.concatenate([np.full(len(e), bool(e.terminated[-1] or e.success)) for e in episodes])
    return {
        "observations": np.concatenate([o[:-1] for o in flat]).astype(np.float32),
        "next_observations": np.concatenate([o[1:] for o in flat]).astype(np.float32),
        "actions": np.concatenate([e.labels for e in episodes]).astype(np.float32),
        "rewards": np.concatenate([e.rewards for e in episodes]).astype(np.float32),
        "terminals": last & over,
        "timeouts": last & ~over,
    }


def _checked(path: Path, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the arrays as float64 (N, ...) of one length."""
    if missing := [name for name in NEEDED if name not in arrays]:
        known = ", ".join(" or ".join(NAMES[name]) for name in missing)
        raise DemoError(path, f"holds no transitions: it lacks {known}.")
    steps = len(arrays["actions"]) if arrays["actions"].ndim else 0
    arrays = {name: _rows(path, name, values) for name, values in arrays.items()}
    for name, values in arrays.items():
        if len(values) != steps:
            raise DemoError(path, f"has {name} of another length than its actions.", expected=steps, got=len(values))
        if not np.isfinite(values).all():
            raise DemoError(path, f"has {name} that are not finite.")
    return arrays


def _rows(path: Path, name: str, values: np.ndarray) -> np.ndarray:
    matrix = name in ("obs", "next_obs", "actions")
    if values.dtype.kind not in "biuf" or values.ndim not in (1, 2) or not values.size:
        raise DemoError(path, f"has {name} that are not rows of numbers.", got=(values.dtype, values.shape))
    flat = values.astype(float).reshape(len(values), -1)
    return flat if matrix else flat[:, 0]
