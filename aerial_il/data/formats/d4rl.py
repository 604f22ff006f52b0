"""D4RL's HDF5: transitions one after the other; names as :mod:`.parts.transitions` lists them.

Source: J. Fu et al., "D4RL: Datasets for Deep Data-Driven Reinforcement Learning", 2020.
"""

from collections.abc import Iterable
from pathlib import Path

import h5py
import numpy as np

from aerial_il.data.episode import Episode
from aerial_il.data.formats.parts.hdf5 import holds, later, opened
from aerial_il.data.formats.parts.transitions import KNOWN, source_of
from aerial_il.data.formats.parts.whole import replacing, require_room
from aerial_il.data.source import Source, Wanted

ENDINGS, OWN_NAME = (".hdf5", ".h5"), "d4rl.hdf5"
PICTURES = False  # an observation is a vector


def recognises(path: Path) -> bool:
    return holds(path, "actions") and not holds(path, "data")


def read(path: Path, wanted: Wanted) -> Source:
    with opened(path, "cannot be read as HDF5") as file:
        return source_of(path, {name: later(path, file, name) for name in KNOWN if name in file})


def write(episodes: Iterable[Episode], out: Path, *, env_spec: str | None = None) -> Path:
    """Write episodes of one environment as one file.

    An observation is all fields of numbers one after the other; their names and sizes stand in ``metadata/fields``.
    """
    episodes = list(episodes)
    observed = episodes[0].spec.observation
    with replacing(out) as temporary, h5py.File(temporary, "w") as file:
        columns = _columns(episodes, observed.state_names)
        require_room(temporary, sum(values.nbytes for values in columns.values()))
        for name, values in columns.items():
            file[name] = values
        file.attrs["made_by"] = "aerial_il"
        file["metadata/fields"] = " ".join(f"{name}:{observed[name].size}" for name in observed.state_names)
    return out


def _columns(episodes: list[Episode], names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Return D4RL's arrays: what nothing can follow ends in a terminal, all else in a timeout."""
    flat = [episode.flat_obs(names) for episode in episodes]
    last = np.concatenate([np.arange(len(episode)) == len(episode) - 1 for episode in episodes])
    over = np.concatenate([np.full(len(e), e.is_terminal) for e in episodes])
    return {
        "observations": np.concatenate([o[:-1] for o in flat]).astype(np.float32),
        "next_observations": np.concatenate([o[1:] for o in flat]).astype(np.float32),
        "actions": np.concatenate([e.labels for e in episodes]).astype(np.float32),
        "rewards": np.concatenate([e.rewards for e in episodes]).astype(np.float32),
        "terminals": last & over,
        "timeouts": last & ~over,
    }
