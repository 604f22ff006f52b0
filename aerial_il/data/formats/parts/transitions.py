"""Transitions one after the other, under the names that D4RL, ``imitation`` and scripts give them.

=============================  ================================  =======================================
what                           names that are understood
=============================  ================================  =======================================
observation before the action  observations, obs                 (N, Do)
action                         actions, acts                     (N, Da)
observation after it           next_observations, next_obs       optional
reward                         rewards, rews                     optional
the environment ended          terminals, terminations           optional; an episode ends there
time was up                    timeouts, truncations             optional; likewise
one of both                    dones                             optional; likewise
time in seconds                timestamps, times                 optional
=============================  ================================  =======================================
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from aerial_il.core.errors import DemoError
from aerial_il.data.source import Raw, Rows, Source

FIELD = "observation"  # what Gymnasium's environments with one vector are recorded with here
NAMES = {
    "obs": ("observations", "obs"),
    "actions": ("actions", "acts"),
    "next_obs": ("next_observations", "next_obs"),
    "rewards": ("rewards", "rews"),
    "terminated": ("terminals", "terminations"),
    "truncated": ("timeouts", "truncations"),
    "done": ("dones",),
    "times": ("timestamps", "times"),
}
KNOWN = tuple(name for names in NAMES.values() for name in names)


def source_of(path: Path, arrays: Mapping[str, Rows]) -> Source:
    """Return the source of a file that holds such arrays, by their own names."""
    held: dict[str, Any] = {what: arrays[name] for what, names in NAMES.items() for name in names if name in arrays}
    if missing := [name for name in ("obs", "actions") if name not in held]:
        known = ", ".join(" or ".join(NAMES[name]) for name in missing)
        raise DemoError(path, f"holds no transitions: it lacks {known}.")
    after = {FIELD: held.pop("next_obs")} if "next_obs" in held else {}
    raw = Raw(obs={FIELD: held.pop("obs")}, next_obs=after, **held)
    return Source(path=path, kind="a file of transitions", raw={"episode": lambda: raw}, borders=False)
