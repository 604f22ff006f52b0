"""Rollouts of single steps: every step is a decision, sampled from the actor's answer to one observation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch

from aerial_il.algorithms.online.interface import decode, encode, standardised
from aerial_il.algorithms.online.moments import RunningMoments
from aerial_il.algorithms.online.run import OnlineRun
from aerial_il.algorithms.run.state import Stateful
from aerial_il.core.tensors import tensor
from aerial_il.policies.parts.network import StochasticNetwork


class Steps(NamedTuple):
    """T steps of n worlds.

    Attributes:
        frames: (T, n, Do) in the world. obs, next_obs: (T, n, Do) encoded; ``next_obs`` was seen before any reset.
        actions: (T, n, Da) normalised. raw: (T, n, R) the samples behind them: pre-tanh samples, or indices of
            discrete actions.
        rewards: (T, n) of the environment. terminal, truncated: (T, n) bool; see :class:`Transition`.
    """

    frames: np.ndarray
    obs: np.ndarray
    next_obs: np.ndarray
    actions: np.ndarray
    raw: np.ndarray
    rewards: np.ndarray
    terminal: np.ndarray
    truncated: np.ndarray

    @property
    def ended(self) -> np.ndarray:
        """(T, n) bool, the step was the last of its episode."""
        return self.terminal | self.truncated

    lasts_a_step = True  # each decision

    @property
    def decided(self) -> np.ndarray:
        """(T, n) bool, a decision starts with the step: always."""
        return np.ones_like(self.terminal)

    def flat(self, name: str) -> np.ndarray:
        """Return one entry as (T * n, ...)."""
        values = getattr(self, name)
        return values.reshape(-1, *values.shape[2:])


class StepFlights:
    """Flies the worlds of a run step by step, with what an actor samples.

    Args:
        run: whose worlds these are. actor: samples.
        obs_norm: whether observations are standardised by the moments of all that was seen.
    """

    def __init__(self, run: OnlineRun, actor: StochasticNetwork, *, obs_norm: bool) -> None:
        self._run, self._actor = run, actor
        self._obs_norm = RunningMoments(run.sizes[0]) if obs_norm else None

    @property
    def parts(self) -> Mapping[str, Stateful]:
        return {"obs_norm": self._obs_norm} if self._obs_norm else {}

    @property
    def flown(self) -> int:
        return self._run.collector.steps

    def standardise(self, rollout: Steps | None = None) -> None:
        run = self._run
        if self._obs_norm is None:
            return
        if rollout is not None:
            self._obs_norm.add(run.interface.layout.relate(rollout.flat("frames")))
        run.interface = standardised(run.interface, self._obs_norm)

    @torch.no_grad()
    def collect(self, steps: int) -> Steps:
        collector, interface = self._run.collector, self._run.interface
        rows: list[tuple[np.ndarray, ...]] = []
        for _ in range(-(-steps // collector.n)):
            frames, obs = collector.frames, encode(interface, collector.frames)
            actions, raw, _ = (drawn.numpy() for drawn in self._actor.sample(tensor(obs)[:, None]))
            step = collector.step(decode(interface, actions, frames))
            after = encode(interface, step.next_frames)
            rows.append((frames, obs, after, actions, raw, step.rewards, step.terminal, step.truncated))
        return Steps(*(np.stack(values) for values in zip(*rows, strict=True)))
