"""Everything about a network in training that a checkpoint must hold to go on bit for bit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from aerial_il.algorithms.supervised.optimisation import Ema, adamw, from_arrays, to_arrays
from aerial_il.core.checkpoint import Checkpoint
from aerial_il.core.errors import TrainingDivergedError
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import ChunkNetwork

HINT = "Lower the learning rate; the last checkpoint is intact."


class Learner:
    """A network, its optimiser, its averaged weights and its counters.

    Args:
        network: what is trained.
        weight_decay: AdamW's decay.
        ema: decay of the averaged weights.
        clip_norm: largest gradient norm.

    Attributes:
        step: optimisation steps done.
        elapsed_s: time spent on them, over all calls.
        averaged: the network that flies.
    """

    def __init__(self, network: ChunkNetwork, *, weight_decay: float, ema: float, clip_norm: float) -> None:
        self.network, self.clip_norm = network.train(), clip_norm
        self.step, self.elapsed_s = 0, 0.0
        self._optimizer = adamw(network, weight_decay=weight_decay)
        self._ema = Ema(network, ema)
        self._sums: dict[str, float] = {}
        self._summed = 0

    @property
    def averaged(self) -> ChunkNetwork:
        return self._ema.network

    def descend(self, loss: Tensor, *, lr: float, logged: Mapping[str, Tensor]) -> None:
        """Take one step against the gradient of ``loss`` and remember it and the ``logged`` scalars.

        Raises:
            TrainingDivergedError: loss or gradient is not finite; the weights are left as they were.
        """
        value = loss.item()
        self._require_finite("The loss", value)
        self._optimizer.zero_grad(set_to_none=True)
        loss.backward()
        norm = torch.nn.utils.clip_grad_norm_(self.network.parameters(), self.clip_norm).item()
        self._require_finite("The gradient", norm)
        for group in self._optimizer.param_groups:
            group["lr"] = lr
        self._optimizer.step()
        self._ema.update(self.step)
        self.step += 1
        self._remember({"loss": value, "grad_norm": norm, **{k: v.item() for k, v in logged.items()}})

    def report(self) -> dict[str, float]:
        """Return the means since the last report."""
        means = {name: total / self._summed for name, total in self._sums.items()}
        self._sums, self._summed = {}, 0
        return means

    def to_checkpoint(self, policy: ChunkPolicy) -> Checkpoint:
        """Return all state, together with ``policy``, which alone is enough to fly."""
        flying = policy.to_checkpoint()
        weights = {f"learner.network.{k}": v.cpu().numpy() for k, v in self.network.state_dict().items()}
        moments = {f"learner.optimizer.{k}": v for k, v in to_arrays(self._optimizer).items()}
        counters = {"step": self.step, "elapsed_s": self.elapsed_s, "sums": self._sums, "summed": self._summed}
        state = {**flying.state, "learner": {**counters, "rng": _rng_state()}}
        return Checkpoint({**flying.arrays, **weights, **moments}, state, flying.config)

    def restore(self, saved: Checkpoint) -> None:
        """Go back to the moment at which ``saved`` was taken, torch's generators included."""
        weights = {k: torch.from_numpy(v.copy()) for k, v in _below("learner.network.", saved.arrays).items()}
        averaged = {k: torch.from_numpy(v.copy()) for k, v in _below("network.", saved.arrays).items()}
        self.network.load_state_dict(weights)
        self.averaged.load_state_dict(averaged)
        from_arrays(self._optimizer, _below("learner.optimizer.", saved.arrays))
        state = saved.state["learner"]
        self.step, self.elapsed_s = state["step"], state["elapsed_s"]
        self._sums, self._summed = dict(state["sums"]), state["summed"]
        _set_rng_state(state["rng"])

    def _require_finite(self, what: str, value: float) -> None:
        if not np.isfinite(value):
            raise TrainingDivergedError(what, step=self.step, hint=HINT)

    def _remember(self, values: Mapping[str, float]) -> None:
        self._summed += 1
        for name, value in values.items():
            self._sums[name] = self._sums.get(name, 0.0) + value


def _below(prefix: str, arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}


def _rng_state() -> dict[str, Any]:
    state = {"cpu": torch.get_rng_state().numpy().tobytes().hex()}
    if torch.cuda.is_available() and torch.cuda.is_initialized():
        state["cuda"] = torch.cuda.get_rng_state().numpy().tobytes().hex()
    return state


def _set_rng_state(state: Mapping[str, str]) -> None:
    decoded = {k: torch.frombuffer(bytearray.fromhex(v), dtype=torch.uint8) for k, v in state.items()}
    torch.set_rng_state(decoded["cpu"])
    if "cuda" in decoded:
        torch.cuda.set_rng_state(decoded["cuda"])
