"""The Adroit hand's experts of DAPG: small Gaussian networks, as plain arrays.

Source: A. Rajeswaran et al., "Learning Complex Dexterous Manipulation with Deep Reinforcement Learning and
Demonstrations", 2018; the networks are those of the authors' repository hand_dapg.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass, field

import numpy as np

from aerial_il.core.bounded import read_npz
from aerial_il.core.contracts import BatchEnv, Observation
from aerial_il.core.errors import InvalidValueError
from aerial_il.core.seeding import named_rng

LAYERS = 3
SHIFTS = ("in_shift", "in_scale", "out_shift", "out_scale", "log_std")
OFFSET = 1e-8  # of the input's scale, as the authors have it


@dataclass
class DapgExpert:
    """Two tanh layers, a linear one, and Gaussian exploration around their answer.

    Args:
        arrays: ``w0, b0, w1, b1, w2, b2`` and the shifts and scales. noise: share of the trained standard deviation
            that actions are drawn with; 0 flies the mean.
    """

    arrays: dict[str, np.ndarray] = field(repr=False)
    noise: float = 1.0
    _env: BatchEnv | None = field(default=None, repr=False)

    @staticmethod
    def load(path: str | os.PathLike[str], task: str, *, noise: float = 1.0) -> DapgExpert:
        """Read the expert for ``task`` from ``dapg_policies.npz``.

        Raises:
            InvalidValueError: the file cannot be read or has no such expert.
        """
        names = [f"{kind}{i}" for i in range(LAYERS) for kind in "wb"] + list(SHIFTS)
        try:
            file = read_npz(path)
            arrays = {name: np.asarray(file[f"{task}/{name}"], float) for name in names}
        except (OSError, ValueError, KeyError) as error:
            raise InvalidValueError(f"{path}: no expert for {task!r} can be read from it ({error}).") from error
        return DapgExpert(arrays, noise)

    def __post_init__(self) -> None:
        if self.noise < 0:
            raise InvalidValueError(f"noise is {self.noise}; it must not be negative.")

    @property
    def sha256(self) -> str:
        """Of its numbers: with the noise and an episode's seed they decide how it flies."""
        return hashlib.sha256(b"".join(self.arrays[name].tobytes() for name in sorted(self.arrays))).hexdigest()

    def attach(self, env: BatchEnv) -> None:
        """Bind to the batch environment whose episodes' seeds decide the noise."""
        self._env = env
        self._rngs: list[np.random.Generator | None] = [None] * env.num_envs

    def reset(self, mask: np.ndarray | None = None) -> None:
        """Begin new episodes in the worlds of ``mask`` (n,), or in all."""
        if self._env is not None:
            for i in range(self._env.num_envs) if mask is None else np.flatnonzero(mask):
                self._rngs[i] = named_rng(int(self._env.seeds[i]), "dapg expert")

    def mean(self, obs: Observation) -> np.ndarray:
        """Return what the expert means to do (n, Da), unclipped, row by row: equal rows, equal bits."""
        a, frames = self.arrays, np.asarray(obs["observation"], float)
        return np.stack([self._mean_of((frame - a["in_shift"]) / (a["in_scale"] + OFFSET)) for frame in frames])

    def act(self, obs: Observation) -> np.ndarray:
        """Return actions (n, Da), drawn around the mean."""
        actions = self.mean(obs)
        if self.noise:
            if self._env is None:
                raise InvalidValueError("The expert is not attached to an environment; call expert.attach(env) first.")
            deviation = self.noise * np.exp(self.arrays["log_std"])
            for i, rng in enumerate(self._rngs):
                actions[i] += deviation * (rng.standard_normal(len(deviation)) if rng else 0.0)
        return actions

    def _mean_of(self, hidden: np.ndarray) -> np.ndarray:
        a = self.arrays
        for i in range(LAYERS - 1):
            hidden = np.tanh(a[f"w{i}"] @ hidden + a[f"b{i}"])
        return (a["w2"] @ hidden + a["b2"]) * a["out_scale"] + a["out_shift"]
