"""A network in supervised training: its optimiser and schedule, averaged weights, counters and metrics."""

import math
from collections.abc import Mapping

import numpy as np
import torch
from torch import Tensor, nn

from aerial_il.algorithms.run.metrics import MetricMeans
from aerial_il.algorithms.run.state import Snapshot, load_weights, weights_of
from aerial_il.algorithms.run.train_state import Follower, TrainState, adamw
from aerial_il.core.errors import InvalidValueError, TrainingDivergedError
from aerial_il.policies.parts.prefixed import below, under

HINT = "Lower the learning rate; the last checkpoint is intact."


def require_device(name: str) -> None:
    """Refuse a torch device that is not there, or that there cannot be."""
    try:
        device = torch.device(name)
    except RuntimeError as error:
        raise InvalidValueError(
            f"algorithm.device={name} is none that torch knows. Use cpu, cuda or cuda:1."
        ) from error
    count = torch.cuda.device_count()
    if device.type == "cuda" and not count:
        raise InvalidValueError(
            f"algorithm.device={name} needs a GPU that torch can use; there is none here. Use algorithm.device=cpu."
        )
    if device.type == "cuda" and (device.index or 0) >= count:
        raise InvalidValueError(f"algorithm.device={name}: there are {count} GPUs here, counted from 0.")


def precision(device: str, *, mixed: bool) -> torch.autocast:
    """Return the context in which the loss is computed: in bfloat16, where that loses little, if ``mixed``."""
    return torch.autocast(torch.device(device).type, dtype=torch.bfloat16, enabled=mixed)


def cosine(progress: float, step: int, *, warmup_steps: int, floor: float) -> float:
    """Return the factor of the peak learning rate: a linear warm-up, then half a cosine wave down to ``floor``.

    Args:
        progress: share of the training that is done, in [0, 1].
        step: steps done.
        warmup_steps: length of the warm-up.
        floor: factor at the end.
    """
    warm = min(1.0, (step + 1) / max(1, warmup_steps))
    return warm * (floor + (1 - floor) * 0.5 * (1 + math.cos(math.pi * min(1.0, progress))))


class Learner[Network: nn.Module]:
    """A network, its optimiser, its averaged weights and its counters.

    The average moves exponentially. Early on it follows faster, ``min(ema, (1 + step) / (10 + step))``, to forget the
    random start.

    Args:
        network: what is trained.
        weight_decay: AdamW's decay.
        ema: decay of the averaged weights.
        clip_norm: largest gradient norm.

    Attributes:
        step: optimisation steps done.
        elapsed_s: time spent on them, over all calls.
        averaged: the network that acts.
        means: of what was logged since the last row of the metrics.
    """

    def __init__(self, network: Network, *, weight_decay: float, ema: float, clip_norm: float) -> None:
        self.network, self.clip_norm = network.train(), clip_norm
        self.step, self.elapsed_s, self.means = 0, 0.0, MetricMeans()
        self._trained = TrainState(network, adamw(network, weight_decay=weight_decay))
        self._ema, self._average = ema, Follower(network)
        self.averaged = self._average.network.eval()

    def descend(self, loss: Tensor, *, lr: float, logged: Mapping[str, Tensor]) -> None:
        """Take one step against the gradient of ``loss``; log it and the ``logged`` scalars.

        Raises:
            TrainingDivergedError: loss or gradient is not finite; the weights are left as they were.
        """
        value = loss.item()
        self._require_finite("The loss", value)
        norm = self._trained.backward(loss, self.clip_norm)
        assert norm is not None
        self._require_finite("The gradient", norm)
        self._trained.set_lr(lr)
        self._trained.optimizer.step()
        self._average.follow(1 - min(self._ema, (1 + self.step) / (10 + self.step)))
        self.step += 1
        self.means.add({"loss": value, "grad_norm": norm, **{k: v.item() for k, v in logged.items()}})

    def snapshot(self) -> Snapshot:
        arrays = {**self._trained.snapshot().arrays, **under("averaged", weights_of(self.averaged))}
        return Snapshot(arrays, {"step": self.step, "elapsed_s": self.elapsed_s, "means": self.means.snapshot().values})

    def restore(self, saved: Snapshot) -> None:
        self._trained.restore(saved)
        load_weights(self.averaged, below("averaged", saved.arrays))
        self.step, self.elapsed_s = saved.values["step"], saved.values["elapsed_s"]
        self.means.restore(Snapshot({}, saved.values["means"]))

    def _require_finite(self, what: str, value: float) -> None:
        if not np.isfinite(value):
            raise TrainingDivergedError(what, step=self.step, hint=HINT)
