"""Exploration around a frozen policy: Gaussian shifts of its actions, each held for some steps, and their pilot."""

import math

import numpy as np
import torch
from torch import Tensor, nn

from aerial_il.algorithms.on_policy.decisions import Acted, Pilot
from aerial_il.algorithms.online.collector import Collector, Transition
from aerial_il.core.tensors import tensor
from aerial_il.policies.parts.chunk_policy import ChunkPolicy
from aerial_il.policies.parts.network import StochasticNetwork
from aerial_il.policies.parts.residual import Shift, normalised, shifted, what_is_seen
from aerial_il.policies.squashed_gaussian import LOG_STD_HIGH, LOG_STD_LOW


class ShiftActor(StochasticNetwork):
    """Samples shifts, before the tanh that bounds them, around a network's answer.

    Args:
        shift: the network. deviation: standard deviation of the pre-tanh samples at the start; learned, one for each
            element.
    """

    def __init__(self, shift: Shift, deviation: float) -> None:
        super().__init__()
        self.shift = shift
        self.log_std = nn.Parameter(torch.full((len(shift.moved),), math.log(deviation)))

    def forward(self, obs: Tensor) -> Tensor:
        """Return shifts (B, 1, Da) for what is seen (B, 1, Do + Da)."""
        return self.shift.bounded(self.shift(obs))

    def distribution(self, obs: Tensor) -> tuple[Tensor, ...]:
        return self.shift(obs)[:, 0], self.log_std.clamp(LOG_STD_LOW, LOG_STD_HIGH)

    def sample(self, obs: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        mean, log_std = self.distribution(obs)
        raw = mean + log_std.exp() * torch.randn_like(mean)
        return self.shift.bounded(raw), raw, self._density(raw, mean, log_std)

    def judge(self, obs: Tensor, drawn: Tensor) -> tuple[Tensor, Tensor]:
        mean, log_std = self.distribution(obs)
        entropy = (self.shift.moved * log_std).sum().expand(len(mean))
        return self._density(drawn, mean, log_std), entropy

    def divergence(self, of: tuple[Tensor, ...], against: tuple[Tensor, ...]) -> Tensor:
        (mean, log_std), (other, other_log_std) = of, against
        spread = ((2 * log_std).exp() + (mean - other) ** 2) / (2 * (2 * other_log_std).exp())
        return (self.shift.moved * (other_log_std - log_std + spread - 0.5)).sum(-1)

    def loss(self, obs: Tensor, actions: Tensor, valid: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        return (((self(obs) - actions) ** 2).mean(-1) * valid).sum() / valid.sum().clamp(min=1.0), {}

    def _density(self, raw: Tensor, mean: Tensor, log_std: Tensor) -> Tensor:
        """Return the log density (B,) of pre-tanh samples ``raw`` (B, Da) in the elements that are moved."""
        each = -0.5 * (((raw - mean) / log_std.exp()) ** 2 + math.log(2 * math.pi)) - log_std
        return (self.shift.moved * each).sum(-1)


class ShiftPilot(Pilot):
    """Flies a frozen policy and shifts its actions, each shift for some steps.

    Args:
        actor: samples shifts. base: proposes; its memory is taken. hold: steps that a shift lasts.
        collector: whose worlds these are.
    """

    changing = ("_base", "_actions", "_proposed")

    def __init__(self, actor: ShiftActor, base: ChunkPolicy, hold: int, collector: Collector) -> None:
        super().__init__(collector)
        self._actor, self._base, self._hold = actor, base, hold
        size = base.spec.action.size
        self._shift, self._age = np.zeros((collector.n, size), np.float32), np.full(collector.n, hold)
        base.attach(collector.env)
        base.reset()
        self._actions = self._proposed = np.zeros((0, size))
        self._propose()

    def cut(self) -> None:
        self._age[:] = self._hold

    @torch.no_grad()
    def act(self) -> Acted:
        interface, frames = self._base.interface, self._collector.frames
        obs, due = what_is_seen(interface, frames, self._proposed), self._age >= self._hold
        raw = np.zeros_like(self._shift)
        if due.any():
            drawn, before, _ = self._actor.sample(tensor(obs[due])[:, None])
            self._shift[due], raw[due], self._age[due] = drawn.numpy(), before.numpy(), 0
        self._age += 1
        return Acted(obs, due, raw, shifted(interface, self._proposed, self._shift, frames, self._actions))

    def after(self, step: Transition) -> np.ndarray:
        """Follow one step. After the last one of an episode the base is not asked: it is taken to propose the same."""
        interface, before, ended = self._base.interface, self._proposed, step.terminal | step.truncated
        if ended.any():
            self._base.reset(ended)
            self._age[ended] = self._hold
        self._propose()
        follows = np.where(ended[:, None], before, self._proposed)
        return what_is_seen(interface, step.next_frames, follows)

    def _propose(self) -> None:
        self._actions = self._base.act(self._collector.obs)
        self._proposed = normalised(self._base.interface, self._actions, self._collector.frames)
